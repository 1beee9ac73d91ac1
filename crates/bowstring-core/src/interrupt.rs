//! Interruption of long work from outside.
//!
//! Loops count their work with [`work`]; after each `QUANTUM` of it the caller of [`watched`] is
//! asked whether to stop. Between two questions a count costs a subtraction. Interrupted work ends
//! early, as if it had not converged, and its results are not to be used.

use std::cell::{Cell, RefCell};
#[cfg(feature = "threads")]
use std::sync::{
    atomic::{AtomicBool, Ordering},
    Arc,
};

/// Work between two questions, in units of [`work`]: about a millisecond.
const QUANTUM: i64 = 1 << 16;

/// Who is asked.
#[derive(Clone)]
enum Ask {
    /// A function of the caller, on the caller's thread.
    Caller(fn() -> bool),
    /// A flag that the caller's thread sets.
    #[cfg(feature = "threads")]
    Flag(Arc<AtomicBool>),
}

impl Ask {
    fn ask(&self) -> bool {
        match self {
            Ask::Caller(ask) => ask(),
            #[cfg(feature = "threads")]
            Ask::Flag(flag) => flag.load(Ordering::Relaxed),
        }
    }
}

thread_local! {
    /// Work left until the next question; negative once interrupted.
    static LEFT: Cell<i64> = const { Cell::new(i64::MAX) };
    static INTERRUPTED: Cell<bool> = const { Cell::new(false) };
    static ASK: RefCell<Option<Ask>> = const { RefCell::new(None) };
}

/// Work that was interrupted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interrupted;

/// Runs work on this thread that ends early once `ask` returns true.
///
/// `ask` is called about once in a millisecond and must be cheap.
///
/// # Errors
/// If the work was interrupted; its result is dropped.
pub fn watched<T>(ask: fn() -> bool, work: impl FnOnce() -> T) -> Result<T, Interrupted> {
    let _outer = Outer::replace(Some(Ask::Caller(ask)));
    let done = work();
    match INTERRUPTED.get() {
        true => Err(Interrupted),
        false => Ok(done),
    }
}

/// The state of work that this work is part of, restored when it is done.
struct Outer {
    left: i64,
    interrupted: bool,
    ask: Option<Ask>,
}

impl Outer {
    fn replace(ask: Option<Ask>) -> Self {
        Outer {
            left: LEFT.replace(if ask.is_some() { QUANTUM } else { i64::MAX }),
            interrupted: INTERRUPTED.replace(false),
            ask: ASK.replace(ask),
        }
    }
}

impl Drop for Outer {
    fn drop(&mut self) {
        LEFT.set(self.left);
        INTERRUPTED.set(self.interrupted);
        ASK.replace(self.ask.take());
    }
}

/// Counts work of about ten nanoseconds a unit; true if it is to end.
#[inline]
pub fn work(units: usize) -> bool {
    let left = LEFT.get() - units as i64;
    LEFT.set(left);
    left < 0 && ask()
}

/// Asks now; true if the work on this thread is to end.
#[cold]
fn ask() -> bool {
    if INTERRUPTED.get() {
        return true;
    }
    // the caller may start other work while it is asked
    let asked = ASK.with_borrow(|ask| ask.clone());
    let interrupted = asked.is_some_and(|asked| asked.ask());
    INTERRUPTED.set(interrupted);
    LEFT.set(if interrupted { -1 } else { QUANTUM });
    interrupted
}

/// Whether the work on this thread was interrupted.
#[inline]
pub fn interrupted() -> bool {
    INTERRUPTED.get()
}

/// Work on other threads that is interrupted together with this thread's.
#[cfg(feature = "threads")]
#[derive(Clone, Default)]
pub(crate) struct Shared {
    flag: Arc<AtomicBool>,
    /// Whether the work is done.
    done: Arc<(std::sync::Mutex<bool>, std::sync::Condvar)>,
}

#[cfg(feature = "threads")]
impl Shared {
    /// Time between two questions, s.
    const INTERVAL: std::time::Duration = std::time::Duration::from_millis(20);

    /// Makes the calling thread one of the others, until it ends.
    pub fn join(&self) {
        LEFT.set(QUANTUM);
        INTERRUPTED.set(false);
        ASK.replace(Some(Ask::Flag(self.flag.clone())));
    }

    /// Tells the waiting thread that the work is done when it is dropped.
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

    /// Waits until the work is done, and passes an interruption on.
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
                if ask() {
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
        static ASKED: Cell<usize> = const { Cell::new(0) };
    }

    fn third_time() -> bool {
        ASKED.set(ASKED.get() + 1);
        ASKED.get() == 3
    }

    #[test]
    fn work_ends_when_it_is_asked_to() {
        ASKED.set(0);
        let mut units = 0;
        let done = watched(third_time, || {
            while !work(1000) {
                units += 1000;
            }
            // and stays so
            assert!(work(1) && interrupted());
        });
        assert_eq!(done, Err(Interrupted));
        assert_eq!(ASKED.get(), 3);
        assert!((2 * QUANTUM..4 * QUANTUM).contains(&units), "{units}");
        assert!(!interrupted() && !work(usize::MAX >> 4));
    }

    #[test]
    fn work_within_work_has_its_own_interruption() {
        ASKED.set(0);
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
