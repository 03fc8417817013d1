//! What lies on the device for one matrix.

use crate::device::GpuDevice;
use crate::memory::tile_sums_bytes;
use crate::plane::Plane;
use crate::recorder::uniform_buffer;
use earthshine_radiosity::BackendError;
use earthshine_shaders::host::{ExchangeEntry, Member, Resident, StripeMarks};
use earthshine_shaders::limits::{BLOCK, RETURN_BANDS, SECTIONS, TILE_EDGE};
use wgpu::{Buffer, BufferUsages};

/// All buffers, allocated once.
#[derive(Debug)]
pub(super) struct Buffers {
    /// Slots in whole stripes.
    pub(super) rows: u32,
    /// `G` of three channels, then `X`.
    pub(super) planes: [Plane; 4],
    pub(super) residents: Buffer,
    /// What a block exchanges directly, a column for each patch.
    pub(super) exchange: Buffer,
    /// Three channels of a block's columns: before the loop is closed, as they will stand in `G`, and the right factor of
    /// the update or a residual.
    pub(super) columns: Buffer,
    pub(super) finals: Buffer,
    pub(super) update: Buffer,
    /// Sections of a gather.
    pub(super) sums: Buffer,
    pub(super) entries: Buffer,
    pub(super) is_named: Buffer,
    pub(super) members: Buffer,
    /// Who wants to enter, by place.
    pub(super) offered: Buffer,
    /// A bit a slot: its patch was refused.
    pub(super) refused: Buffer,
    /// Residents as they were when a fresh solve began.
    pub(super) residents_before: Buffer,
    /// N, K and `among` of three channels.
    pub(super) small: Buffer,
    /// What comes back to a block, in bands; what its members exchange among themselves.
    pub(super) returned: Buffer,
    pub(super) among: Buffer,
    /// Vectors of three channels.
    pub(super) own: Buffer,
    pub(super) outside: Buffer,
    pub(super) sent: Buffer,
    pub(super) irradiance: Buffer,
    /// For the drift probe: what arrives by `H`, and by `F` of what that makes leave.
    pub(super) probed: Buffer,
    pub(super) gathered: Buffer,
    pub(super) tiles: Buffer,
    pub(super) marks: Buffer,
    pub(super) tile_sums: Buffer,
    pub(super) uniforms: Buffer,
}

/// Numbers of a small matrix.
const SMALL_LEN: usize = (BLOCK * BLOCK) as usize;

impl Buffers {
    pub(super) fn new(device: &GpuDevice, capacity: u32) -> Result<Self, BackendError> {
        let stripes = capacity.div_ceil(TILE_EDGE);
        let rows = stripes * TILE_EDGE;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let buffer = |label: &str, numbers: u64| device.buffer(label, 4 * numbers, usage);
        let vector = |label: &str| buffer(label, 3 * u64::from(rows));
        let columns = |label: &str, count: u64| buffer(label, count * u64::from(rows) * u64::from(BLOCK));
        let plane = |label: &str| Plane::new(device, label, stripes);
        let planes = [plane("G red")?, plane("G green")?, plane("G blue")?, plane("X")?];
        let sections = u64::from(SECTIONS) * planes[0].parts.len() as u64;
        let size = |bytes: usize| bytes as u64 / 4;
        Ok(Self {
            rows,
            planes,
            residents: buffer("residents", size(size_of::<Resident>()) * u64::from(rows))?,
            exchange: columns("exchange", 1)?,
            columns: columns("columns", 3)?,
            finals: columns("finals", 3)?,
            update: columns("update", 3)?,
            sums: columns("sums", 3 * sections)?,
            entries: columns("entries", size(size_of::<ExchangeEntry>()))?,
            is_named: buffer("is named", u64::from(stripes))?,
            members: buffer("members", size(size_of::<Member>()) * u64::from(BLOCK))?,
            offered: buffer("offered", size(size_of::<Resident>()) * u64::from(BLOCK))?,
            refused: buffer("refused", u64::from(rows / 32))?,
            residents_before: buffer("residents before", size(size_of::<Resident>()) * u64::from(rows))?,
            small: buffer("small", 9 * SMALL_LEN as u64)?,
            returned: buffer("returned", 3 * u64::from(RETURN_BANDS) * SMALL_LEN as u64)?,
            among: buffer("among", 3 * SMALL_LEN as u64)?,
            own: vector("own")?,
            outside: vector("outside")?,
            sent: vector("sent")?,
            irradiance: vector("irradiance")?,
            probed: vector("probed")?,
            gathered: vector("gathered")?,
            tiles: buffer("tiles", u64::from(stripes) * u64::from(stripes + 1) / 2)?,
            marks: buffer("marks", size(size_of::<StripeMarks>()) * u64::from(stripes))?,
            tile_sums: buffer("tile sums", tile_sums_bytes(capacity) / 4)?,
            uniforms: uniform_buffer(device)?,
        })
    }
}
