//! A backend that forgets all patches at once.

use super::{COUNT, Pair, SETTLING, settings};
use crate::backend::{Backend, Slot};
use crate::solver::shooting::SETTLE_FRAMES;

/// Goal: a cleared backend is as good as a new one. Method: lit, cleared, and filled with half as many patches.
#[test]
fn what_is_cleared_is_as_new() {
    for method in SETTLING {
        let mut pair = Pair::new(settings(method));
        pair.shine(10.0, 1.0);
        pair.step(3);
        let leaving = pair.streamed.leave(COUNT as usize);
        pair.oracle.apply(&leaving).expect("residents");
        pair.backend.clear().expect("no device to lose");
        assert!((0..COUNT).all(|slot| !pair.backend.is_taken(Slot(slot))), "{method}");
        pair.step(1);
        let entering = pair.streamed.enter(COUNT as usize / 2);
        pair.oracle.apply(&entering).expect("free slots");
        pair.backend.apply(&entering).expect("free slots");
        pair.shine(3.0, 0.5);
        pair.step(SETTLE_FRAMES);
        let error = pair.error();
        assert!(error < 1e-4, "{method}: {error}");
    }
}
