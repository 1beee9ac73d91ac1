//! Statuses, and the text of the last error.

use std::cell::RefCell;
use std::ffi::{c_char, CString};
use std::panic::{catch_unwind, AssertUnwindSafe};

/// How a call ended: 0 for success, positive for a result without success, negative for a wrong
/// call.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BowstringStatus {
    /// Success. A forward solve has converged to an equilibrium that is not known to be unstable
    /// (see `stable`); an inverse has reached its target within 1e-6 of the robot's length.
    Ok = 0,
    /// Inverse: limits or robot do not allow the target. The tensions are those of a nearest tip.
    Unreachable = 1,
    /// Forward: no convergence, no result. Inverse: a nearer tip may exist; the tensions are those
    /// of the nearest that was found.
    MaxIterations = 2,
    /// Forward: there is an equilibrium, but no stable one; no result.
    Unstable = 3,
    /// The load has no equilibrium, or only one in which disks collide; no result.
    NoEquilibrium = 4,
    /// The equilibrium has no finite derivatives, or the tendons touch the body everywhere; no
    /// result.
    NoDerivatives = 5,
    /// Inverse: the tensions have several equilibria, and the one that follows from the last
    /// solution is another than that whose tip is at the target.
    OtherEquilibrium = 6,
    /// An argument is wrong, or a query has no solution to ask about. Nothing was solved.
    BadInput = -1,
    /// An error in the library. Free the solver and make another.
    Internal = -2,
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Keeps the sentence for [`bowstring_last_error`].
pub(crate) fn fail(status: BowstringStatus, sentence: impl ToString) -> BowstringStatus {
    let text = sentence.to_string().replace('\0', " ");
    LAST.with_borrow_mut(|last| *last = CString::new(text).unwrap_or_default());
    status
}

/// Runs the work of a call; a panic becomes a status.
pub(crate) fn guarded(work: impl FnOnce() -> BowstringStatus) -> BowstringStatus {
    // what a panic leaves behind is refused later, or was not handed over yet
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or(panic.downcast_ref::<&str>().copied());
        let text = text.unwrap_or("no message");
        fail(
            BowstringStatus::Internal,
            format!("error in the library, please report it: {text}"),
        )
    })
}

/// Sentence about the last call of this thread that did not end with `BOWSTRING_STATUS_OK`, or
/// returned `NULL`: UTF-8, never `NULL`. It is valid until the next such call of the same thread.
#[no_mangle]
pub extern "C" fn bowstring_last_error() -> *const c_char {
    LAST.with_borrow(|last| last.as_ptr())
}

/// Version of the library, such as "0.1.0". It is valid for ever.
#[no_mangle]
pub extern "C" fn bowstring_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    #[test]
    fn a_panic_becomes_a_status_with_its_message() {
        for work in [
            (|| panic!("tendon {} is lost", 3)) as fn() -> BowstringStatus,
            || panic!("tendon 3 is lost"),
        ] {
            assert_eq!(guarded(work), BowstringStatus::Internal);
            // SAFETY: the text of this thread
            let said = unsafe { CStr::from_ptr(bowstring_last_error()) };
            assert!(said.to_str().unwrap().ends_with("tendon 3 is lost"));
        }
        fail(BowstringStatus::BadInput, "a zero\0 within");
        // SAFETY: the text of this thread
        let said = unsafe { CStr::from_ptr(bowstring_last_error()) };
        assert_eq!(said.to_str(), Ok("a zero  within"));
    }
}
