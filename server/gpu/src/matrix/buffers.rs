//! What lies on the device for one matrix: one list of its buffers, by which they are allocated, counted and held against
//! limits.

use crate::device::{GpuDevice, buffer_bytes};
use crate::plane::Plane;
use crate::rays::STORAGE;
use crate::recorder::{UNIFORM, UNIFORM_BYTES};
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::{ExchangeEntry, Member, Resident, StripeMarks};
use earthshine_shaders::limits::{BLOCK, RETURN_BANDS, SECTIONS, TILE_EDGE};
use std::convert::Infallible;
use wgpu::{Buffer, BufferUsages};

/// All buffers, allocated once; or what stands for each of them.
#[derive(Debug)]
pub(super) struct Buffers<B = Buffer> {
    /// Slots in whole stripes.
    pub(super) rows: u32,
    /// `G` of three channels, then `X`.
    pub(super) planes: [Plane<B>; 4],
    pub(super) residents: B,
    /// What a block exchanges directly, a column for each patch.
    pub(super) exchange: B,
    /// Three channels of a block's columns: before the loop is closed, as they will stand in `G`, and the right factor of
    /// the update or a residual.
    pub(super) columns: B,
    pub(super) finals: B,
    pub(super) update: B,
    /// Sections of a gather.
    pub(super) sums: B,
    pub(super) entries: B,
    pub(super) is_named: B,
    pub(super) members: B,
    /// Who wants to enter, by place.
    pub(super) offered: B,
    /// A bit a slot: its patch was refused.
    pub(super) refused: B,
    /// Residents as they were when a fresh solve began.
    pub(super) residents_before: B,
    /// N, K and `among` of three channels.
    pub(super) small: B,
    /// What comes back to a block, in bands; what its members exchange among themselves.
    pub(super) returned: B,
    pub(super) among: B,
    /// Vectors of three channels.
    pub(super) own: B,
    pub(super) outside: B,
    pub(super) sent: B,
    pub(super) irradiance: B,
    /// For the drift probe: what arrives by `H`, and by `F` of what that makes leave.
    pub(super) probed: B,
    pub(super) gathered: B,
    pub(super) tiles: B,
    pub(super) marks: B,
    pub(super) tile_sums: B,
    pub(super) uniforms: B,
}

/// Numbers of a small matrix.
const SMALL_LEN: u64 = (BLOCK * BLOCK) as u64;

impl Buffers {
    pub(super) fn new(device: &GpuDevice, capacity: u32) -> Result<Self, BackendError> {
        Self::lay_out(capacity, device.part_bytes_max(), |label, bytes, usage| {
            device.buffer(label, bytes, usage)
        })
    }
}

/// What the buffers of a matrix of `capacity` slots take, planes in parts of at most `part_bytes_max` bytes, and what each is
/// for.
pub(crate) fn sizes(capacity: u32, part_bytes_max: u64) -> Vec<(u64, BufferUsages)> {
    let mut sizes = Vec::new();
    let Ok(_) = Buffers::lay_out(capacity, part_bytes_max, |_, bytes, usage| {
        sizes.push((buffer_bytes(bytes), usage));
        Ok::<(), Infallible>(())
    });
    sizes
}

impl<B> Buffers<B> {
    /// Asks `make` for each buffer, by its name, bytes and what it is for.
    fn lay_out<E>(
        capacity: u32,
        part_bytes_max: u64,
        mut make: impl FnMut(&str, u64, BufferUsages) -> Result<B, E>,
    ) -> Result<Self, E> {
        let stripe_count = capacity.div_ceil(TILE_EDGE);
        let rows = stripe_count * TILE_EDGE;
        let stripes = u64::from(stripe_count);
        let mut buffer = |label: &str, numbers: u64| make(label, 4 * numbers, STORAGE);
        let mut plane =
            |label: &str| Plane::lay_out(stripe_count, part_bytes_max, |numbers| buffer(label, numbers));
        let planes = [plane("G red")?, plane("G green")?, plane("G blue")?, plane("X")?];
        let sections = u64::from(SECTIONS) * planes[0].parts.len() as u64;
        let vector = 3 * u64::from(rows);
        let columns = u64::from(rows) * u64::from(BLOCK);
        let size = |bytes: usize| bytes as u64 / 4;
        let residents = size(size_of::<Resident>()) * u64::from(rows);
        Ok(Self {
            rows,
            planes,
            residents: buffer("residents", residents)?,
            exchange: buffer("exchange", columns)?,
            columns: buffer("columns", 3 * columns)?,
            finals: buffer("finals", 3 * columns)?,
            update: buffer("update", 3 * columns)?,
            sums: buffer("sums", 3 * sections * columns)?,
            entries: buffer("entries", size(size_of::<ExchangeEntry>()) * columns)?,
            is_named: buffer("is named", stripes)?,
            members: buffer("members", size(size_of::<Member>()) * u64::from(BLOCK))?,
            offered: buffer("offered", size(size_of::<Resident>()) * u64::from(BLOCK))?,
            refused: buffer("refused", u64::from(rows / 32))?,
            residents_before: buffer("residents before", residents)?,
            small: buffer("small", 9 * SMALL_LEN)?,
            returned: buffer("returned", 3 * u64::from(RETURN_BANDS) * SMALL_LEN)?,
            among: buffer("among", 3 * SMALL_LEN)?,
            own: buffer("own", vector)?,
            outside: buffer("outside", vector)?,
            sent: buffer("sent", vector)?,
            irradiance: buffer("irradiance", vector)?,
            probed: buffer("probed", vector)?,
            gathered: buffer("gathered", vector)?,
            tiles: buffer("tiles", stripes * (stripes + 1) / 2)?,
            marks: buffer("marks", size(size_of::<StripeMarks>()) * stripes)?,
            tile_sums: buffer("tile sums", 3 * stripes * stripes * u64::from(TILE_EDGE))?,
            uniforms: make("passes", UNIFORM_BYTES, UNIFORM)?,
        })
    }
}
