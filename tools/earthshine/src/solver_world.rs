//! Patches of a whole world in a solver's slots: what benches and animations let light move on.

use earthshine_radiosity::gather::SparseRows;
use earthshine_radiosity::solver::backend::MatrixFactory;
use earthshine_radiosity::solver::{Method, SolverBackend, SolverSettings};
use earthshine_radiosity::{Backend, BackendError, CpuBackend, Slot, Update};
use earthshine_world::Rgb;

/// In place of the slot of a patch that is not resident.
pub(crate) const FAR: u32 = u32::MAX;

/// A solver by its name on the command line. Not the matrix: it is what the others are held against.
pub(crate) fn method(name: &str) -> Result<Method, String> {
    let found = Method::ALL.into_iter().find(|method| method.name() == name && *method != Method::Matrix);
    found.ok_or_else(|| format!("{name:?} is not gather, alias, cdf, progressive or hybrid"))
}

/// `patches` (ascending) of `rows` in slots of the same order, and the slot of every patch.
pub(crate) fn backend(
    rows: &SparseRows,
    areas: &[f32],
    reflectance: &[Rgb],
    patches: &[u32],
) -> Result<(SolverBackend, Vec<u32>), BackendError> {
    let matrix = |slots| {
        let too_large =
            |_| BackendError::OutOfMemory { slots, bytes: earthshine_radiosity::LocalMatrix::bytes(slots) };
        CpuBackend::new(slots).map(|backend| Box::new(backend) as Box<dyn Backend>).map_err(too_large)
    };
    let settings = SolverSettings { method: Method::Gather, ..SolverSettings::default() };
    backend_of(rows, areas, reflectance, patches, settings, Box::new(matrix))
}

/// The same, solving by `settings`, with matrices made by `matrix` where that takes one.
pub(crate) fn backend_of(
    rows: &SparseRows,
    areas: &[f32],
    reflectance: &[Rgb],
    patches: &[u32],
    settings: SolverSettings,
    matrix: MatrixFactory,
) -> Result<(SolverBackend, Vec<u32>), BackendError> {
    let mut slot_of = vec![FAR; areas.len()];
    patches.iter().zip(0..).for_each(|(&patch, slot)| slot_of[patch as usize] = slot);
    let mut backend = SolverBackend::new(patches.len() as u32, settings, matrix)?;
    for (slot, &patch) in (0u32..).zip(patches) {
        let area = areas[patch as usize];
        let (mut row, mut column) = (Vec::new(), Vec::new());
        let (columns, shares) = rows.row(patch as usize);
        for (&other, &share) in columns.iter().zip(shares) {
            let seen = slot_of[other as usize];
            if seen > slot {
                continue;
            }
            let other_area = areas[other as usize];
            // As the engine does it: rounding on disk may carry the share of a tiny patch past one.
            let share = share.min(other_area / area);
            row.push((Slot(seen), share));
            if seen != slot {
                column.push((Slot(seen), (share * area / other_area).min(1.0)));
            }
        }
        let reflectance = reflectance[patch as usize];
        backend.apply(&[Update::Add { slot: Slot(slot), reflectance, area, row, column }])?;
    }
    Ok((backend, slot_of))
}
