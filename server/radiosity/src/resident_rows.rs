//! Form factors between resident patches, sparse: what `H` stands for, kept to probe it and to solve it afresh.
//!
//! A patch that leaves would have to be struck from every row that sees it. Instead each slot counts
//! its tenants, an entry remembers which tenant it meant, and stale entries are dropped when a row would
//! have to grow. So a row never holds more than twice its live entries, or the least room there is. Room comes in powers of
//! two, and what one row gave back another takes: of each size there is what all rows needed at some moment, not what
//! each slot ever did, and nothing is allocated once that is there. Rows that grew side by side have left less than as much
//! again behind.

/// One form factor.
#[derive(Debug, Clone, Copy)]
struct Entry {
    slot: u16,
    /// Tenant of `slot` that is meant.
    tenant: u16,
    share: f32,
}

/// Entries that the smallest row has room for.
const ROOM_MIN: usize = 16;

/// One row a slot; rows of free slots are empty and have no room.
#[derive(Debug)]
pub(crate) struct ResidentRows {
    rows: Vec<Vec<Entry>>,
    tenants: Vec<u16>,
    /// Empty rows by the room they have, [`ROOM_MIN`] entries and twice as many each.
    spare: Vec<Vec<Vec<Entry>>>,
}

impl ResidentRows {
    /// Rows for `capacity` slots; at most 65,536.
    pub(crate) fn new(capacity: usize) -> Self {
        debug_assert!(capacity <= 1 << 16, "slots are u16 here");
        Self { rows: vec![Vec::new(); capacity], tenants: vec![0; capacity], spare: Vec::new() }
    }

    /// Notes `F[row, column]`.
    pub(crate) fn insert(&mut self, row: usize, column: usize, share: f32) {
        let entry = Entry { slot: column as u16, tenant: self.tenants[column], share };
        if self.rows[row].len() == self.rows[row].capacity() {
            let tenants = &self.tenants;
            self.rows[row].retain(|entry| tenants[usize::from(entry.slot)] == entry.tenant);
            let (live, room) = (self.rows[row].len(), self.rows[row].capacity());
            if live * 2 > room || room == 0 {
                let mut wider = self.take_room(2 * room);
                wider.extend_from_slice(&self.rows[row]);
                let narrower = std::mem::replace(&mut self.rows[row], wider);
                self.give_room(narrower);
            }
        }
        self.rows[row].push(entry);
    }

    /// An empty row for `count` entries.
    fn take_room(&mut self, count: usize) -> Vec<Entry> {
        let room = count.max(ROOM_MIN);
        let spare = self.spare.get_mut(class_of(room)).and_then(Vec::pop);
        spare.unwrap_or_else(|| Vec::with_capacity(room))
    }

    /// Takes back the room of a row, whatever is in it.
    fn give_room(&mut self, mut row: Vec<Entry>) {
        if row.capacity() == 0 {
            return;
        }
        row.clear();
        let class = class_of(row.capacity());
        if self.spare.len() <= class {
            self.spare.resize_with(class + 1, Vec::new);
        }
        self.spare[class].push(row);
    }

    /// Forgets the patch in `slot`, as a row and as a column.
    pub(crate) fn remove(&mut self, slot: usize) {
        let row = std::mem::take(&mut self.rows[slot]);
        self.give_room(row);
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

    /// Memory of the rows, room for more entries included, bytes.
    pub(crate) fn bytes(&self) -> usize {
        let room: usize = self.rows.iter().chain(self.spare.iter().flatten()).map(Vec::capacity).sum();
        room * size_of::<Entry>()
    }
}

/// Which list of spare rows one with room for `room` entries belongs to.
fn class_of(room: usize) -> usize {
    (room / ROOM_MIN).max(1).ilog2() as usize
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

    /// Goal: room follows what all rows need at a moment, not what each slot ever held. Method: one long row, in each slot in turn.
    #[test]
    fn a_long_row_leaves_its_room_to_the_next() {
        let mut rows = ResidentRows::new(256);
        let mut most = 0;
        for slot in 0..256 {
            (0..200).for_each(|column| rows.insert(slot, column, 1e-3));
            assert_eq!(rows.row(slot).count(), 200);
            most = most.max(rows.bytes());
            rows.remove(slot);
        }
        assert_eq!(rows.bytes(), most, "as after the first");
        assert!(most <= 2 * 256 * size_of::<Entry>(), "{most}");
    }

    /// Goal: rows that grow side by side, as a patch that comes is seen by many, leave less behind on their way than they hold.
    #[test]
    fn rows_that_grow_together_hold_less_than_twice_what_they_need() {
        let mut rows = ResidentRows::new(256);
        (0..200).for_each(|column| (0..256).for_each(|row| rows.insert(row, column, 1e-3)));
        let needed = 256 * 256 * size_of::<Entry>();
        assert!(rows.bytes() >= needed && rows.bytes() < 2 * needed, "{}", rows.bytes());
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
        assert!(rows.bytes() < 64 * 16 * size_of::<Entry>(), "{}", rows.bytes());
    }
}
