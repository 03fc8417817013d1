//! Keeps a device busy: some questions are on their way to it while the next is made.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Mutex;
use std::sync::mpsc::sync_channel;

/// Questions that one asker has with the device, beside the one that is made.
pub(crate) const ON_THEIR_WAY: usize = 2;

/// Asks what `next` gives until it gives nothing more and all is heard; hears answers in any order. `answer` is called on
/// threads of its own; where it has none, nobody is there to be asked, and what is on its way is the last. Both ends work
/// on `state`, which may grow new questions with what is heard.
pub(crate) fn ask_all<S, Q: Send, A: Send>(
    state: &mut S,
    mut next: impl FnMut(&mut S) -> Option<Q>,
    answer: impl Fn(&Q) -> Option<A> + Sync,
    mut hear: impl FnMut(&mut S, Q, A),
) {
    let Some(first) = next(state) else { return };
    let (asked, questions) = sync_channel::<Q>(0);
    let questions = Mutex::new(questions);
    // Room for what all threads may have to say: none of them waits to say it.
    let (told, answers) = sync_channel(ON_THEIR_WAY + 1);
    std::thread::scope(|scope| {
        // Dropped with this closure, also when it panics: that ends the threads.
        let asked = asked;
        for _ in 0..ON_THEIR_WAY {
            let (told, questions, answer) = (told.clone(), &questions, &answer);
            scope.spawn(move || {
                let receive = || questions.lock().ok().and_then(|questions| questions.recv().ok());
                while let Some(question) = receive() {
                    // Who waits for the answer would wait for ever if this thread ended without one.
                    let answer = catch_unwind(AssertUnwindSafe(|| answer(&question)));
                    if told.send((question, answer)).is_err() {
                        return;
                    }
                }
            });
        }
        let (mut on_their_way, mut is_answered, mut question) = (0, true, Some(first));
        loop {
            let arrived = match question.take() {
                Some(question) => {
                    asked.send(question).expect("threads listen until this end is gone");
                    on_their_way += 1;
                    answers.try_recv().ok()
                }
                None if on_their_way > 0 => answers.recv().ok(),
                None => return,
            };
            if let Some((question, answer)) = arrived {
                on_their_way -= 1;
                match answer {
                    Ok(Some(answer)) => hear(state, question, answer),
                    Ok(None) => is_answered = false,
                    Err(panic) => resume_unwind(panic),
                }
            }
            if is_answered {
                question = next(state);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    /// Asks for the squares of numbers, of which those above ten have to be asked once more, less one.
    fn squares(numbers: impl Iterator<Item = u64>, answers_max: usize) -> (Vec<u64>, usize) {
        let (asked, together, most) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
        let mut state = (numbers.collect::<VecDeque<u64>>(), Vec::new());
        ask_all(
            &mut state,
            |(waiting, _)| waiting.pop_front(),
            |&number| {
                most.fetch_max(together.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                std::thread::sleep(Duration::from_millis(1));
                together.fetch_sub(1, Ordering::SeqCst);
                (asked.fetch_add(1, Ordering::SeqCst) < answers_max).then_some(number * number)
            },
            |(waiting, squares), number, square| match number {
                0..=10 => squares.push(square),
                _ => waiting.push_back(number - 1),
            },
        );
        state.1.sort_unstable();
        (state.1, most.into_inner())
    }

    #[test]
    fn everything_is_answered_and_some_at_once() {
        let (found, most) = squares(0..20, usize::MAX);
        let expected: Vec<u64> = (0..=10).map(|n| n * n).chain([100; 9]).collect();
        assert_eq!((found, most), (expected, ON_THEIR_WAY));
        assert_eq!(squares(0..0, usize::MAX), (Vec::new(), 0));
    }

    #[test]
    #[should_panic(expected = "no answer")]
    fn a_panic_of_who_answers_is_no_silence() {
        let panics = |&number: &u64| (number < 3).then_some(number).or_else(|| panic!("no answer"));
        ask_all(&mut (0..9u64), Iterator::next, panics, |_, _, _| ());
    }

    #[test]
    fn where_nobody_answers_it_ends() {
        for answers in [0, 1, 5] {
            assert!(squares(0..11, answers).0.len() <= answers);
        }
    }
}
