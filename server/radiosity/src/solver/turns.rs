//! Whose table is rebuilt next: `Turns`. Urgent rows first, and a part of every step goes round all of them, so that none
//! waits for ever while urgent ones keep changing.

use super::links::LinkRows;

/// Of a step's items: one part goes to rows in turn, the rest to the most urgent.
const TURN_PART: u32 = 4;

/// What a step rebuilt.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rebuilt {
    /// Tables.
    pub rows: u32,
    /// Items of them.
    pub items: u64,
    /// Rows that still wait.
    pub waiting: u32,
}

/// Which slots' tables are older than their rows.
#[derive(Debug)]
pub struct Turns {
    is_old: Vec<bool>,
    old_count: usize,
    /// Where the round goes on.
    cursor: usize,
}

impl Turns {
    /// Every taken slot waits.
    #[must_use]
    pub fn new(links: &LinkRows) -> Self {
        let is_old = (0..links.capacity()).map(|slot| links.is_taken(slot)).collect();
        Self { is_old, old_count: links.taken_count(), cursor: 0 }
    }

    /// The row of `slot` is no longer what its table says.
    pub fn outdate(&mut self, slot: usize) {
        self.old_count += usize::from(!std::mem::replace(&mut self.is_old[slot], true));
    }

    /// `slot` has no row any more, or a new table.
    pub fn settle(&mut self, slot: usize) {
        self.old_count -= usize::from(std::mem::take(&mut self.is_old[slot]));
    }

    /// Calls `rebuild`, which says how many items it took, for rows that wait, until `items_max` are exceeded: first of
    /// `order`, then in turn.
    ///
    /// # Errors
    /// The first that `rebuild` says; its row waits still.
    pub fn rebuild<E>(
        &mut self,
        order: &[u32],
        items_max: u32,
        mut rebuild: impl FnMut(usize) -> Result<usize, E>,
    ) -> Result<Rebuilt, E> {
        let mut rebuilt = Rebuilt::default();
        let for_urgent = u64::from(items_max - items_max / TURN_PART);
        let mut urgent = order.iter();
        while rebuilt.items < for_urgent
            && let Some(&slot) = urgent.next()
        {
            self.take(slot as usize, &mut rebuilt, &mut rebuild)?;
        }
        for _ in 0..self.is_old.len() {
            if self.old_count == 0 || rebuilt.items >= u64::from(items_max) {
                break;
            }
            let slot = self.cursor;
            self.cursor = (slot + 1) % self.is_old.len();
            self.take(slot, &mut rebuilt, &mut rebuild)?;
        }
        rebuilt.waiting = self.old_count as u32;
        Ok(rebuilt)
    }

    /// Rebuilds the table of `slot` if it waits.
    fn take<E>(
        &mut self,
        slot: usize,
        rebuilt: &mut Rebuilt,
        rebuild: &mut impl FnMut(usize) -> Result<usize, E>,
    ) -> Result<(), E> {
        if self.is_old[slot] {
            rebuilt.items += rebuild(slot)? as u64;
            rebuilt.rows += 1;
            self.settle(slot);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use earthshine_world::Rgb;

    fn turns(count: usize) -> Turns {
        let mut links = LinkRows::new(count);
        (0..count).for_each(|slot| links.add(slot, 1.0, Rgb::ZERO, std::iter::empty()));
        Turns::new(&links)
    }

    fn step(turns: &mut Turns, order: &[u32], items_max: u32) -> (Vec<usize>, Rebuilt) {
        let mut rebuilt = Vec::new();
        let done = turns.rebuild(order, items_max, |slot| {
            rebuilt.push(slot);
            Ok::<_, ()>(10)
        });
        (rebuilt, done.expect("nothing fails"))
    }

    #[test]
    fn urgent_rows_come_first_and_a_quarter_goes_round() {
        let mut turns = turns(20);
        let (rows, done) = step(&mut turns, &[19, 18, 17, 16, 15], 40);
        assert_eq!(rows, [19, 18, 17, 0]);
        assert_eq!(done, Rebuilt { rows: 4, items: 40, waiting: 16 });
        // What is urgent is outdated again and again: the others have their turn all the same.
        let mut seen = rows;
        for _ in 0..20 {
            [17, 18, 19].into_iter().for_each(|slot| turns.outdate(slot));
            seen.extend(step(&mut turns, &[19, 18, 17, 16, 15], 40).0);
        }
        assert!((0..20).all(|slot| seen.contains(&slot)), "{seen:?}");
    }

    #[test]
    fn without_an_order_all_have_their_turn() {
        let mut turns = turns(7);
        let first = step(&mut turns, &[], 25).0;
        let second = step(&mut turns, &[], u32::MAX);
        assert_eq!((first, second.0), (vec![0, 1, 2], vec![3, 4, 5, 6]));
        assert_eq!(second.1.waiting, 0);
        assert_eq!(step(&mut turns, &[3], 25).1, Rebuilt::default());
        turns.outdate(2);
        turns.settle(2);
        assert_eq!(step(&mut turns, &[], 1).1.rows, 0);
    }
}
