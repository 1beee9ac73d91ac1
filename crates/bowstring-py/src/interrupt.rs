//! Ctrl-C during work of the core, which runs without the interpreter lock.

use bowstring_core::interrupt;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

/// Time between two checks for signals.
const INTERVAL: Duration = Duration::from_millis(50);

thread_local! {
    /// Time of the last check for signals.
    static LOOKED: Cell<Option<Instant>> = const { Cell::new(None) };
    /// Exception raised by a signal handler.
    static RAISED: RefCell<Option<PyErr>> = const { RefCell::new(None) };
}

/// Runs work without the interpreter lock; a signal whose handler raises, such as that of Ctrl-C,
/// ends it with that exception.
///
/// Python runs handlers on its main thread only: work on other threads is not interrupted.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    py.detach(|| {
        LOOKED.set(None);
        interrupt::watched(look, work).map_err(|_| {
            RAISED
                .take()
                .unwrap_or_else(|| PyKeyboardInterrupt::new_err(()))
        })
    })
}

/// Whether a signal has arrived whose handler raises.
fn look() -> bool {
    let now = Instant::now();
    match LOOKED.get() {
        Some(last) if now - last < INTERVAL => return false,
        // the first poll comes after little work
        None => {
            LOOKED.set(Some(now));
            return false;
        }
        _ => {}
    }
    let looked = Python::attach(|py| py.check_signals());
    LOOKED.set(Some(Instant::now()));
    match looked {
        Ok(()) => false,
        Err(raised) => {
            RAISED.replace(Some(raised));
            true
        }
    }
}
