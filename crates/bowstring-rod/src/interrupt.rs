//! Interruption of long work by the caller, and bounds of the work of one answer.
//!
//! Loops count their work with [`work`]; after each `QUANTUM` of it the caller of [`watched`] is
//! polled for an interruption. Between two polls, counting costs an addition. Interrupted work
//! ends early, as if it had not converged, and its results must not be used. Work beyond the bound
//! of [`bounded`] ends in the same way; that it did not converge is its result.
#![warn(missing_docs)]

use std::cell::{Cell, RefCell};
#[cfg(feature = "threads")]
use std::sync::{
    atomic::{AtomicBool, Ordering},
    Arc,
};

/// Work between two polls, in units of [`work`]: about a millisecond.
const QUANTUM: u64 = 1 << 16;

/// What is polled for an interruption.
#[derive(Clone)]
enum Poll {
    /// A function of the caller, on the caller's thread.
    Caller(fn() -> bool),
    /// A flag that the caller's thread sets.
    #[cfg(feature = "threads")]
    Flag(Arc<AtomicBool>),
}

impl Poll {
    fn check(&self) -> bool {
        match self {
            Poll::Caller(ask) => ask(),
            #[cfg(feature = "threads")]
            Poll::Flag(flag) => flag.load(Ordering::Relaxed),
        }
    }
}

thread_local! {
    /// Work until now, and the amounts at which the caller is polled and the bound is reached.
    static SPENT: Cell<u64> = const { Cell::new(0) };
    static NEXT_POLL: Cell<u64> = const { Cell::new(u64::MAX) };
    static BOUND: Cell<u64> = const { Cell::new(u64::MAX) };
    /// The lesser of both.
    static NEXT: Cell<u64> = const { Cell::new(u64::MAX) };
    static INTERRUPTED: Cell<bool> = const { Cell::new(false) };
    static POLL: RefCell<Option<Poll>> = const { RefCell::new(None) };
}

/// Error of work that was interrupted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupted;

/// Runs work on this thread and ends it early when `ask` returns true.
///
/// `ask` is called about once in a millisecond and must be cheap.
///
/// # Errors
/// If the work was interrupted; its result is dropped.
pub fn watched<T>(ask: fn() -> bool, work: impl FnOnce() -> T) -> Result<T, Interrupted> {
    let _outer = Outer::replace(Some(Poll::Caller(ask)));
    let done = work();
    match INTERRUPTED.get() {
        true => Err(Interrupted),
        false => Ok(done),
    }
}

/// State of the enclosing work, restored when this work is done.
struct Outer {
    spent: u64,
    next_poll: u64,
    bound: u64,
    interrupted: bool,
    poll: Option<Poll>,
}

impl Outer {
    fn replace(poll: Option<Poll>) -> Self {
        let next_poll = if poll.is_some() { QUANTUM } else { u64::MAX };
        let outer = Outer {
            spent: SPENT.replace(0),
            next_poll: NEXT_POLL.replace(next_poll),
            bound: BOUND.replace(u64::MAX),
            interrupted: INTERRUPTED.replace(false),
            poll: POLL.replace(poll),
        };
        set_next();
        outer
    }
}

impl Drop for Outer {
    fn drop(&mut self) {
        SPENT.set(self.spent);
        NEXT_POLL.set(self.next_poll);
        BOUND.set(self.bound);
        INTERRUPTED.set(self.interrupted);
        POLL.replace(self.poll.take());
        set_next();
    }
}

fn set_next() {
    NEXT.set(NEXT_POLL.get().min(BOUND.get()));
}

/// Counts work of about ten nanoseconds a unit; true if it must end.
#[inline]
pub fn work(units: usize) -> bool {
    let spent = SPENT.get().saturating_add(units as u64);
    SPENT.set(spent);
    spent > NEXT.get() && must_end_now()
}

/// Polls if it is time; true if the work on this thread must end.
#[cold]
fn must_end_now() -> bool {
    if SPENT.get() > NEXT_POLL.get() {
        poll();
    }
    must_end()
}

/// Polls now; true if the work on this thread was interrupted.
fn poll() -> bool {
    if INTERRUPTED.get() {
        return true;
    }
    // the caller may start other work while it is polled
    let current = POLL.with_borrow(|poll| poll.clone());
    let interrupted = current.is_some_and(|poll| poll.check());
    INTERRUPTED.set(interrupted);
    // after an interruption the next work ends at once
    let wait = if interrupted { 0 } else { QUANTUM };
    NEXT_POLL.set(SPENT.get().saturating_add(wait));
    set_next();
    interrupted
}

/// Whether the work on this thread must end: it was interrupted, or has reached its bound.
#[inline]
pub fn must_end() -> bool {
    INTERRUPTED.get() || SPENT.get() > BOUND.get()
}

/// Bounds the work on this thread, as long as the answer lives, to so many units from now; not
/// beyond a bound that is there.
pub fn bounded(units: usize) -> impl Drop {
    struct Bounded(u64);
    impl Drop for Bounded {
        fn drop(&mut self) {
            BOUND.set(self.0);
            set_next();
        }
    }
    let outer = BOUND.get();
    BOUND.set(outer.min(SPENT.get().saturating_add(units as u64)));
    set_next();
    Bounded(outer)
}

/// Whether the work on this thread was interrupted.
#[inline]
pub fn interrupted() -> bool {
    INTERRUPTED.get()
}

/// Work on other threads that is interrupted together with this thread's.
#[cfg(feature = "threads")]
#[derive(Clone, Default)]
pub struct Shared {
    flag: Arc<AtomicBool>,
    /// Whether the work is done.
    done: Arc<(std::sync::Mutex<bool>, std::sync::Condvar)>,
}

#[cfg(feature = "threads")]
impl Shared {
    /// Time between two polls (s).
    const INTERVAL: std::time::Duration = std::time::Duration::from_millis(20);

    /// Lets the calling thread share the interruption flag until it ends.
    pub fn join(&self) {
        NEXT_POLL.set(SPENT.get() + QUANTUM);
        INTERRUPTED.set(false);
        POLL.replace(Some(Poll::Flag(self.flag.clone())));
        set_next();
    }

    /// Guard that notifies the waiting thread when the work is done.
    pub fn finisher(&self) -> impl Drop {
        struct Finisher(Shared);
        impl Drop for Finisher {
            fn drop(&mut self) {
                let (done, signal) = &*self.0.done;
                *done.lock().unwrap_or_else(|e| e.into_inner()) = true;
                signal.notify_all();
            }
        }
        Finisher(self.clone())
    }

    /// Waits until the work is done, and forwards an interruption.
    pub fn wait(&self) {
        let (done, signal) = &*self.done;
        let mut finished = done.lock().unwrap_or_else(|e| e.into_inner());
        while !*finished {
            finished = match signal.wait_timeout(finished, Self::INTERVAL) {
                Ok((guard, _)) => guard,
                Err(poisoned) => poisoned.into_inner().0,
            };
            if !*finished {
                drop(finished);
                if poll() {
                    self.flag.store(true, Ordering::Relaxed);
                }
                finished = done.lock().unwrap_or_else(|e| e.into_inner());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    thread_local! {
        static POLLED: Cell<usize> = const { Cell::new(0) };
    }

    fn third_time() -> bool {
        POLLED.set(POLLED.get() + 1);
        POLLED.get() == 3
    }

    #[test]
    fn work_ends_on_interruption() {
        POLLED.set(0);
        let mut units = 0;
        let done = watched(third_time, || {
            while !work(1000) {
                units += 1000;
            }
            // and stays interrupted
            assert!(work(1) && interrupted());
        });
        assert_eq!(done, Err(Interrupted));
        assert_eq!(POLLED.get(), 3);
        assert!(
            (2 * QUANTUM..4 * QUANTUM).contains(&(units as u64)),
            "{units}"
        );
        assert!(!interrupted() && !work(usize::MAX >> 4));
    }

    #[test]
    fn work_ends_at_its_bound() {
        let units = || (0..1_000_000).take_while(|_| !work(1)).count();
        {
            let _outer = bounded(1000);
            {
                let _inner = bounded(100);
                assert_eq!(units(), 100);
                assert!(work(1) && must_end() && !interrupted());
            }
            let _longer = bounded(100_000);
            assert!(!must_end());
            assert_eq!(units(), 898);
            // other work has its own bounds
            assert_eq!(watched(|| false, units), Ok(1_000_000));
            assert!(work(1));
        }
        assert_eq!(units(), 1_000_000);
    }

    #[test]
    fn work_within_work_has_its_own_interruption() {
        POLLED.set(0);
        let done = watched(
            || false,
            || {
                let inner = watched(third_time, || while !work(1000) {});
                assert_eq!(inner, Err(Interrupted));
                assert!(!work(1 << 20));
                7
            },
        );
        assert_eq!(done, Ok(7));
    }
}
