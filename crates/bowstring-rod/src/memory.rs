//! Memory estimates, checked before work begins: a failed allocation would abort the process.
#![warn(missing_docs)]

use crate::interrupt;
use crate::model::error::InputError;

/// Bytes below which nothing is checked.
const SMALL: f64 = 16e6;

/// Checks that so many bytes can be allocated.
///
/// # Errors
/// If they cannot: "... would take 259 GB of memory, more than is available; ...", with what needs
/// the memory and what to do.
pub fn check(bytes: f64, what: impl FnOnce() -> String, cure: &str) -> Result<(), InputError> {
    if bytes < SMALL {
        return Ok(());
    }
    let mut probe = Vec::<u8>::new();
    // as a float it may exceed every size
    if bytes < isize::MAX as f64 && probe.try_reserve_exact(bytes as usize).is_ok() {
        return Ok(());
    }
    Err(InputError::other(format!(
        "{} would take {} GB of memory, more than is available; {cure}",
        what(),
        Digits(1e-9 * bytes)
    )))
}

/// A vector of `NaN`, for results that are not known yet.
///
/// # Errors
/// If it does not fit into memory, with the sentence of `refused`.
pub fn unknown(
    len: Option<usize>,
    refused: &dyn Fn() -> InputError,
) -> Result<Vec<f64>, InputError> {
    filled(f64::NAN, len, refused)
}

/// A vector of copies of a value.
///
/// # Errors
/// As [`unknown`].
pub fn filled<T: Clone>(
    value: T,
    len: Option<usize>,
    refused: &dyn Fn() -> InputError,
) -> Result<Vec<T>, InputError> {
    const STRIDE: usize = 1 << 16;
    let mut v = Vec::new();
    match len.map(|len| v.try_reserve_exact(len)) {
        Some(Ok(())) => {}
        _ => return Err(refused()),
    }
    in_large_pages(&v);
    let len = len.unwrap_or(0);
    while v.len() < len {
        if interrupt::work(STRIDE / 16) {
            return Err(InputError::other("the work was interrupted"));
        }
        v.resize(len.min(v.len() + STRIDE), value.clone());
    }
    Ok(v)
}

/// Asks for large pages under a large vector that is not written yet. The first write of each page
/// takes a page fault, and these take as long as a part of the work that fills the vector.
#[cfg(target_os = "linux")]
fn in_large_pages<T>(v: &Vec<T>) {
    /// Bytes from which it pays, and a multiple of every size of small pages.
    const LARGE: usize = 1 << 22;
    const ALIGNED: usize = 1 << 16;
    let start = v.as_ptr() as usize;
    let end = start + v.capacity() * size_of::<T>();
    let (first, last) = (start.next_multiple_of(ALIGNED), end & !(ALIGNED - 1));
    if end - start < LARGE {
        return;
    }
    // SAFETY: the pages are within the allocation, and this advice does not change their content;
    // where it is refused nothing changes.
    unsafe {
        libc::madvise(
            first as *mut libc::c_void,
            last - first,
            libc::MADV_HUGEPAGE,
        );
    }
}

#[cfg(not(target_os = "linux"))]
fn in_large_pages<T>(_: &Vec<T>) {}

/// A number with three significant digits.
struct Digits(f64);

impl std::fmt::Display for Digits {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Digits(value) = *self;
        if value >= 1e6 {
            return write!(f, "{value:.2e}");
        }
        let decimals = (2 - value.log10().floor() as i32).max(0) as usize;
        write!(f, "{value:.decimals$}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_much_memory_is_rejected_with_its_size() {
        let refused = check(3e17, || "a matrix".into(), "take less").unwrap_err();
        assert_eq!(
            refused.to_string(),
            "a matrix would take 3.00e8 GB of memory, more than is available; take less"
        );
        assert!(check(f64::INFINITY, || "all".into(), "").is_err());
        assert!(check(1e3, || "little".into(), "").is_ok());
        assert!(check(2e7, || "some".into(), "").is_ok());
    }
}
