//! Form factors between resident patches, sparse: what `H` stands for, kept to probe it and to solve it afresh.
//!
//! A patch that leaves would have to be struck from every row that sees it. Instead each slot counts
//! its tenants, an entry remembers which tenant it meant, and stale entries are dropped when a row would
//! have to grow. So a row never holds more than twice its live entries, or its first allocation.

/// One form factor.
#[derive(Debug, Clone, Copy)]
struct Entry {
    slot: u16,
    /// Tenant of `slot` that is meant.
    tenant: u16,
    share: f32,
}

/// One row a slot; rows of free slots are empty.
#[derive(Debug)]
pub(crate) struct ResidentRows {
    rows: Vec<Vec<Entry>>,
    tenants: Vec<u16>,
}

impl ResidentRows {
    /// Rows for `capacity` slots; at most 65,536.
    pub(crate) fn new(capacity: usize) -> Self {
        debug_assert!(capacity <= 1 << 16, "slots are u16 here");
        Self { rows: vec![Vec::new(); capacity], tenants: vec![0; capacity] }
    }

    /// Notes `F[row, column]`.
    pub(crate) fn insert(&mut self, row: usize, column: usize, share: f32) {
        let entry = Entry { slot: column as u16, tenant: self.tenants[column], share };
        let row = &mut self.rows[row];
        if row.len() == row.capacity() {
            let tenants = &self.tenants;
            row.retain(|entry| tenants[usize::from(entry.slot)] == entry.tenant);
            if row.len() * 2 > row.capacity() {
                row.reserve(row.len());
            }
        }
        row.push(entry);
    }

    /// Forgets the patch in `slot`, as a row and as a column.
    pub(crate) fn remove(&mut self, slot: usize) {
        self.rows[slot].clear();
        let next = self.tenants[slot].wrapping_add(1);
        self.tenants[slot] = next;
        if next == 0 {
            // The count starts over: entries of earlier tenants would come back to life, so none may be left.
            for row in &mut self.rows {
                row.retain(|entry| usize::from(entry.slot) != slot);
            }
        }
    }

    /// Live entries of `row`: column, form factor. A column may come twice; its shares add up.
    pub(crate) fn row(&self, row: usize) -> impl Iterator<Item = (usize, f32)> + Clone + '_ {
        self.rows[row]
            .iter()
            .filter(|entry| self.tenants[usize::from(entry.slot)] == entry.tenant)
            .map(|entry| (usize::from(entry.slot), entry.share))
    }

    #[cfg(test)]
    fn stored(&self) -> usize {
        self.rows.iter().map(Vec::capacity).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_tenant_does_not_inherit() {
        let mut rows = ResidentRows::new(3);
        rows.insert(0, 1, 0.5);
        rows.insert(1, 0, 0.25);
        rows.remove(1);
        assert_eq!((rows.row(0).count(), rows.row(1).count()), (0, 0));
        rows.insert(0, 1, 0.125);
        assert_eq!(rows.row(0).collect::<Vec<_>>(), [(1, 0.125)]);
    }

    /// Goal: bounded memory, and no ghosts when the count of tenants wraps. Method: 200,000 tenants of one slot.
    #[test]
    fn many_tenants_take_no_more_room_than_a_few() {
        let mut rows = ResidentRows::new(64);
        rows.insert(3, 9, 0.5);
        for _ in 0..200_000 {
            (0..8).for_each(|row| rows.insert(row, 9, 0.1));
            rows.remove(9);
        }
        assert!((0..64).all(|row| rows.row(row).next().is_none()));
        assert!(rows.stored() < 64 * 16, "{}", rows.stored());
    }
}
