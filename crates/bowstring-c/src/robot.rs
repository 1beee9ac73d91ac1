//! The robot: read once, then immutable.

use crate::status::{fail, guarded, BowstringStatus};
use bowstring_compiled::{self as compiled, Compiled};
use std::ffi::{c_char, CStr};
use std::fs::File;
use std::io::Read;
use std::ptr::null_mut;

/// A robot; immutable.
pub struct BowstringRobot(pub(crate) Compiled);

/// Largest file of a robot (bytes).
const MOST_BYTES: u64 = 100_000_000;

/// Reads a robot from the text of a file of `bowstring export`.
///
/// `text` is UTF-8 of `size` bytes; it need not end with a zero. Returns `NULL` where it is no such
/// text, or where the numbers are not those of a robot. Free the robot with `bowstring_robot_free`.
///
/// # Safety
/// `text` must point to `size` readable bytes.
#[no_mangle]
pub unsafe extern "C" fn bowstring_robot_from_text(
    text: *const c_char,
    size: usize,
) -> *mut BowstringRobot {
    made(|| {
        if text.is_null() {
            return Err("text is NULL".into());
        }
        // SAFETY: the caller gives `size` readable bytes
        compiled::read(unsafe { std::slice::from_raw_parts(text.cast(), size) })
    })
}

/// Reads a robot from a file of `bowstring export`.
///
/// `path` is UTF-8 and ends with a zero. Returns `NULL` where the file cannot be read, otherwise as
/// `bowstring_robot_from_text`.
///
/// # Safety
/// `path` must point to a text that ends with a zero.
#[no_mangle]
pub unsafe extern "C" fn bowstring_robot_from_file(path: *const c_char) -> *mut BowstringRobot {
    made(|| {
        if path.is_null() {
            return Err("path is NULL".into());
        }
        // SAFETY: the caller gives a text that ends with a zero
        let path = unsafe { CStr::from_ptr(path) };
        let path = path.to_str().map_err(|_| "path is no text in UTF-8")?;
        let unread = |error: std::io::Error| format!("{path} cannot be read: {error}");
        // the size that a device states is none: it may have no end
        let mut text = Vec::new();
        File::open(path)
            .and_then(|file| file.take(MOST_BYTES + 1).read_to_end(&mut text))
            .map_err(unread)?;
        if text.len() as u64 > MOST_BYTES {
            return Err(format!(
                "{path} has more than {MOST_BYTES} bytes, which is no compiled robot"
            ));
        }
        compiled::read(&text).map_err(|sentence| format!("{path}: {sentence}"))
    })
}

fn made(read: impl FnOnce() -> Result<Compiled, String>) -> *mut BowstringRobot {
    let mut robot = null_mut();
    guarded(|| match read() {
        Ok(compiled) => {
            robot = Box::into_raw(Box::new(BowstringRobot(compiled)));
            BowstringStatus::Ok
        }
        Err(sentence) => fail(BowstringStatus::BadInput, sentence),
    });
    robot
}

/// Frees a robot; `NULL` is allowed. Its solvers stay valid.
///
/// # Safety
/// `robot` must be `NULL`, or come from this library and not have been freed.
#[no_mangle]
pub unsafe extern "C" fn bowstring_robot_free(robot: *mut BowstringRobot) {
    if !robot.is_null() {
        guarded(|| {
            // SAFETY: it is from `Box::into_raw`, and the caller frees it once
            drop(unsafe { Box::from_raw(robot) });
            BowstringStatus::Ok
        });
    }
}

/// Number of tendons; 0 for `NULL`.
///
/// # Safety
/// `robot` must be `NULL` or a robot of this library.
#[no_mangle]
pub unsafe extern "C" fn bowstring_robot_tendon_count(robot: *const BowstringRobot) -> usize {
    // SAFETY: the caller gives a robot
    unsafe { robot.as_ref() }.map_or(0, |robot| robot.0.robot.tendon_count())
}

/// Length of the straight backbone in m; NaN for `NULL`.
///
/// # Safety
/// `robot` must be `NULL` or a robot of this library.
#[no_mangle]
pub unsafe extern "C" fn bowstring_robot_length(robot: *const BowstringRobot) -> f64 {
    // SAFETY: the caller gives a robot
    unsafe { robot.as_ref() }.map_or(f64::NAN, |robot| robot.0.robot.length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::bowstring_last_error;

    const TEXT: &str = r#"{
        "format": "bowstring compiled robot", "format_version": 1, "tendon_path": "straight",
        "segments": [{"sections": [[1, 1, 0, 0.8, 3e5, 1e5, 0.01, 1e-8, 0, 0, 0]], "stiffness": null}],
        "disks": [{"station_m": 0.1, "clamped_length_m": 0, "hole_length_m": 0, "mass_kg": 0.01,
                   "inertia_kg_m2": [1e-6, 2e-6], "segment": 0}],
        "tendons": [{"holes_m": [[0.01, 0]], "end_disk": 0, "compliance_m_per_N": 0,
                     "pretension_N": 0, "max_tension_N": 50}],
        "payloads": [], "gravity_m_per_s2": [0, 0, 0]
    }"#;

    /// The sentence with which a text is refused; empty where it is read.
    fn refusal(text: &str) -> String {
        // SAFETY: the text is readable, and what is made of it is freed once
        unsafe {
            let robot = bowstring_robot_from_text(text.as_ptr().cast(), text.len());
            let made = !robot.is_null();
            bowstring_robot_free(robot);
            let said = CStr::from_ptr(bowstring_last_error());
            made.then(String::new)
                .unwrap_or_else(|| said.to_str().unwrap().into())
        }
    }

    #[test]
    fn damaged_texts_are_refused_in_a_short_line() {
        assert_eq!(refusal(TEXT), "");
        for (from, to, words) in [
            (
                "0.01, 0]]",
                &format!("{:?}]]", "a".repeat(5000)),
                "invalid type",
            ),
            (
                "\"straight\"",
                &format!("\"{}\"", "a".repeat(5000)),
                "at line 2",
            ),
            ("straight", &r"\u001b[31m\n".into(), "unknown variant"),
            ("50", &"1e308".into(), "max_tension_N of tendon 1 is 1e308"),
            (
                "\"compliance_m_per_N\": 0",
                &"\"compliance_m_per_N\": -1".into(),
                "from 0 to 1e30",
            ),
        ] as [(&str, &String, &str); 5]
        {
            let said = refusal(&TEXT.replacen(from, to, 1));
            assert!(said.contains(words), "{said}");
            assert!(
                said.len() < 400 && !said.contains(char::is_control),
                "{said:?}"
            );
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_device_without_an_end_is_no_robot() {
        // SAFETY: the text ends with a zero
        let robot = unsafe { bowstring_robot_from_file(c"/dev/zero".as_ptr()) };
        assert!(robot.is_null());
    }
}
