//! Whose turn it is at the queues: Vulkan lets one thread at a time use them, and two roles may share one.

use std::sync::{Arc, Condvar, Mutex, PoisonError};

/// A lock whose holder may hand it to another thread.
#[derive(Debug, Default)]
pub(crate) struct Turns {
    taken: Mutex<bool>,
    given_back: Condvar,
}

/// Nobody else uses a queue of the device while this lives.
#[derive(Debug)]
pub struct Turn {
    turns: Arc<Turns>,
}

impl Turns {
    /// Waits for its turn.
    pub fn take(self: &Arc<Turns>) -> Turn {
        let taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let mut taken = self
            .given_back
            .wait_while(taken, |taken| *taken)
            .unwrap_or_else(PoisonError::into_inner);
        *taken = true;
        Turn { turns: self.clone() }
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        *self.turns.taken.lock().unwrap_or_else(PoisonError::into_inner) = false;
        self.turns.given_back.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn one_at_a_time_and_from_thread_to_thread() {
        let turns = Arc::<Turns>::default();
        let inside = AtomicU32::new(0);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..500 {
                        let turn = turns.take();
                        assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                        std::thread::yield_now();
                        inside.fetch_sub(1, Ordering::SeqCst);
                        // Given back by another thread.
                        scope.spawn(move || drop(turn));
                    }
                });
            }
        });
        drop(turns.take());
    }
}
