//! Calls from compiled JAX programs: handlers of XLA's foreign function interface.
//!
//! The structures are those of `xla/ffi/api/c_api.h`, API versions 0.1 to 0.3, as far as they are
//! used. Later versions only append fields, so each size is a least one. The handlers hold no
//! interpreter lock.

use crate::equilibria::{registered, wanted};
use bowstring_core::statics::equilibria::Inputs;
use bowstring_core::statics::solver::Status;
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyDict};
use std::ffi::{c_char, c_void, CString};
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::ptr::{null_mut, NonNull};
use std::slice;

/// Latest version of the interface that is known to have these structures, and the first one.
const MAJOR: i32 = 0;
const MINOR: i32 = 3;
const FIRST_MINOR: i32 = 1;

const METADATA: i32 = 1;
const EXECUTE: i32 = 3;
const BUFFER: i32 = 1;
const SCALAR: i32 = 3;
const STRING: i32 = 4;
const TRUTH: i32 = 1;
const I64: i32 = 5;
const F64: i32 = 12;
const INVALID_ARGUMENT: i32 = 3;
const INTERNAL: i32 = 13;

/// An error of XLA.
enum XlaError {}

#[repr(C)]
struct Extension {
    size: usize,
    kind: i32,
    next: *mut Extension,
}

#[repr(C)]
struct Version {
    size: usize,
    extension: *mut Extension,
    major: i32,
    minor: i32,
}

#[repr(C)]
struct Metadata {
    size: usize,
    version: Version,
    traits: u32,
}

#[repr(C)]
struct MetadataExtension {
    base: Extension,
    metadata: *mut Metadata,
}

#[repr(C)]
struct ErrorArguments {
    size: usize,
    extension: *mut Extension,
    message: *const c_char,
    code: i32,
}

/// The first of the functions of XLA.
#[repr(C)]
struct Api {
    size: usize,
    extension: *mut Extension,
    version: Version,
    internal: *const c_void,
    create_error: Option<unsafe extern "C" fn(*mut ErrorArguments) -> *mut XlaError>,
}

#[repr(C)]
struct Buffer {
    size: usize,
    extension: *mut Extension,
    kind: i32,
    data: *mut c_void,
    rank: i64,
    dimensions: *const i64,
}

/// Arguments or results: `count` types and pointers.
#[repr(C)]
struct Buffers {
    size: usize,
    extension: *mut Extension,
    count: i64,
    types: *const i32,
    values: *const *const c_void,
}

#[repr(C)]
struct Text {
    start: *const u8,
    length: usize,
}

#[repr(C)]
struct Number {
    kind: i32,
    value: *const c_void,
}

#[repr(C)]
struct Attributes {
    size: usize,
    extension: *mut Extension,
    count: i64,
    types: *const i32,
    names: *const *const Text,
    values: *const *const c_void,
}

#[repr(C)]
struct Frame {
    size: usize,
    extension: *mut Extension,
    api: *const Api,
    context: *mut c_void,
    stage: i32,
    arguments: Buffers,
    results: Buffers,
    attributes: Attributes,
}

/// Code and sentence of an error.
type Failure = (i32, String);

fn invalid(sentence: impl Into<String>) -> Failure {
    (INVALID_ARGUMENT, sentence.into())
}

/// Calls as capsules by the names of their targets.
#[pyfunction]
pub fn xla_targets(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let targets = PyDict::new(py);
    for (name, target) in [
        ("bowstring_solve", solve as *mut c_void),
        ("bowstring_linearise", linearise as *mut c_void),
    ] {
        let target = NonNull::new(target).expect("functions have an address");
        // SAFETY: the pointer is that of a function, which lives as long as the process.
        let capsule =
            unsafe { PyCapsule::new_with_pointer(py, target, c"xla._CUSTOM_CALL_TARGET")? };
        targets.set_item(name, capsule)?;
    }
    Ok(targets)
}

/// Equilibria of all rows.
unsafe extern "C" fn solve(frame: *mut Frame) -> *mut XlaError {
    // SAFETY: XLA calls it with a frame of its own.
    unsafe { handle(frame, false) }
}

/// Equilibria and derivatives of all rows.
unsafe extern "C" fn linearise(frame: *mut Frame) -> *mut XlaError {
    // SAFETY: XLA calls it with a frame of its own.
    unsafe { handle(frame, true) }
}

/// # Safety
/// The frame must be one of XLA, whose major version 0 the structures describe.
unsafe fn handle(frame: *mut Frame, jacobians: bool) -> *mut XlaError {
    // a panic must not reach XLA
    let done = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: as the function's own.
        unsafe { execute(frame, jacobians) }
    }));
    let failure = match done {
        Ok(Ok(())) => return null_mut(),
        Ok(Err(failure)) => failure,
        Err(_) => (
            INTERNAL,
            "the solver failed; this is an error of Bowstring".into(),
        ),
    };
    // SAFETY: as the function's own; all versions have these fields at the start of the frame.
    match unsafe { (*frame).api.as_ref() } {
        // SAFETY: the functions are those of XLA.
        Some(api) => unsafe { error(api, failure) },
        // only a question for metadata comes without functions; it stays unanswered then
        None => null_mut(),
    }
}

/// # Safety
/// The functions must be those of XLA.
unsafe fn error(api: &Api, (code, sentence): Failure) -> *mut XlaError {
    let message = CString::new(sentence).unwrap_or_default();
    let mut arguments = ErrorArguments {
        size: size_of::<i32>() + std::mem::offset_of!(ErrorArguments, code),
        extension: null_mut(),
        message: message.as_ptr(),
        code,
    };
    match api.create_error {
        // SAFETY: the arguments live until the end of the call, which copies the message.
        Some(create) => unsafe { create(&mut arguments) },
        None => null_mut(),
    }
}

/// Checks the size of a structure, which grows with the version of XLA.
fn check_size(name: &str, size: usize, least: usize) -> Result<(), Failure> {
    match size >= least {
        true => Ok(()),
        false => Err(invalid(format!(
            "jaxlib has another version of XLA's foreign function interface: {name} has {size} \
             bytes, Bowstring needs {least}; install a jaxlib of the versions that the extra jax \
             names"
        ))),
    }
}

/// # Safety
/// As for [`handle`].
unsafe fn execute(frame: *mut Frame, jacobians: bool) -> Result<(), Failure> {
    // SAFETY: all versions have these fields at the start; the others are used after the check.
    let (frame, api) = unsafe { (&*frame, (*frame).api.as_ref()) };
    check_size("the frame", frame.size, size_of::<Frame>())?;
    // SAFETY: the extensions are a list of XLA, which lives as long as the call.
    if let Some(extension) = unsafe { metadata(frame.extension) } {
        // SAFETY: the extension is one of metadata, as its kind says.
        return unsafe { describe(api, &*extension) };
    }
    if frame.stage != EXECUTE {
        let stage = frame.stage;
        return Err(invalid(format!("a call in stage {stage} of the execution")));
    }
    // SAFETY: the values are those of the frame, which live as long as the call.
    let (arguments, results) = unsafe { (buffers(&frame.arguments)?, buffers(&frame.results)?) };
    // SAFETY: as above.
    let (robot, threads, by_gravity) = unsafe { attributes(&frame.attributes)? };
    let function = registered(robot).ok_or_else(|| {
        invalid(format!(
            "robot {robot} is not known in this process: make its bowstring.jax.Solver before the \
             compiled function is called"
        ))
    })?;
    let [tensions, gravity, tip_force, tip_moment, stiffness] = &arguments[..] else {
        let count = arguments.len();
        return Err(invalid(format!(
            "a call with {count} arguments in place of 5"
        )));
    };
    let spec = function.robot().spec();
    let (tendons, segments) = (spec.tendons.len(), spec.backbone.len());
    // the last dimension is that of a row
    let rows = gravity.numbers() / 3;
    // SAFETY: XLA fills the arguments before the call and does not change them until its end.
    let found = unsafe {
        let inputs = Inputs {
            count: rows,
            tensions: tensions.read("tensions", rows * tendons)?,
            gravity: gravity.read("gravity", rows * 3)?,
            tip_force: tip_force.read("tip_force", rows * 3)?,
            tip_moment: tip_moment.read("tip_moment", rows * 3)?,
            stiffness: stiffness.read("stiffness", rows * segments)?,
        };
        function.evaluate(&inputs, threads, wanted(jacobians, by_gravity))
    };
    let found = found.map_err(|e| invalid(e.to_string()))?;
    let solutions = &found.solutions;
    let truth = |of: fn(&bowstring_core::statics::solver::Outcome) -> bool| -> Vec<u8> {
        let outcomes = solutions.outcomes.iter();
        outcomes.map(|outcome| u8::from(of(outcome))).collect()
    };
    let converged = truth(|o| o.status == Status::Converged);
    let stable = truth(|o| o.status == Status::Converged && o.stable == Some(true));
    let wanted = if jacobians { 6 } else { 5 };
    if results.len() != wanted {
        let count = results.len();
        return Err(invalid(format!(
            "a call with {count} results in place of {wanted}"
        )));
    }
    // SAFETY: XLA reserves memory of these shapes for the results, which nobody else uses until the
    // end of the call.
    unsafe {
        results[0].write("tip_position", F64, &solutions.tip_position)?;
        results[1].write("tip_rotation", F64, &solutions.tip_rotation)?;
        results[2].write("tendon_lengths", F64, &solutions.tendon_length)?;
        results[3].write("converged", TRUTH, &converged)?;
        results[4].write("stable", TRUTH, &stable)?;
        if jacobians {
            results[5].write("derivatives", F64, &found.jacobians)?;
        }
    }
    Ok(())
}

/// The extension that asks what the handler supports, if it is in the list.
///
/// # Safety
/// The list must be one of XLA.
unsafe fn metadata(mut extension: *mut Extension) -> Option<*mut MetadataExtension> {
    while !extension.is_null() {
        // SAFETY: it is a node of the list.
        unsafe {
            if (*extension).kind == METADATA && (*extension).size >= size_of::<MetadataExtension>()
            {
                return Some(extension.cast());
            }
            extension = (*extension).next;
        }
    }
    None
}

/// Answers with the version of the interface: the runtime's own where it is older, as the first
/// ones accept no other. These do not say theirs.
///
/// # Safety
/// As for [`handle`].
unsafe fn describe(api: Option<&Api>, extension: &MetadataExtension) -> Result<(), Failure> {
    let least = std::mem::offset_of!(Metadata, traits) + size_of::<u32>();
    // SAFETY: XLA reserves the metadata; its size is its first field.
    let metadata = unsafe { extension.metadata.as_mut() };
    let Some(metadata) = metadata else {
        return Err(invalid("no place for the metadata"));
    };
    check_size("the metadata", metadata.size, least)?;
    let version = |api: &Api| [api.version.major, api.version.minor];
    let [major, minor] = api.map_or([MAJOR, FIRST_MINOR], version);
    if major != MAJOR {
        return Err(invalid(format!(
            "jaxlib has version {major}.{minor} of XLA's foreign function interface, Bowstring \
             knows {MAJOR}.{MINOR}; install a jaxlib of the versions that the extra jax names"
        )));
    }
    metadata.version.major = MAJOR;
    metadata.version.minor = MINOR.min(minor);
    metadata.traits = 0;
    Ok(())
}

/// # Safety
/// The buffers must be those of a frame.
unsafe fn buffers(all: &Buffers) -> Result<Vec<&Buffer>, Failure> {
    check_size("the list of buffers", all.size, size_of::<Buffers>())?;
    let count = usize::try_from(all.count).unwrap_or(0);
    let buffer = |i: usize| {
        // SAFETY: there are `count` types and values.
        let (kind, value) = unsafe { (*all.types.add(i), (*all.values.add(i)).cast::<Buffer>()) };
        if kind != BUFFER {
            return Err(invalid(format!(
                "a value of kind {kind} in place of a buffer"
            )));
        }
        // SAFETY: a value of this kind is a buffer.
        let buffer = unsafe { &*value };
        check_size("a buffer", buffer.size, size_of::<Buffer>())?;
        Ok(buffer)
    };
    (0..count).map(buffer).collect()
}

/// The robot, the number of threads, and whether derivatives by gravity are wanted.
///
/// # Safety
/// The attributes must be those of a frame.
unsafe fn attributes(all: &Attributes) -> Result<(&str, usize, bool), Failure> {
    check_size("the list of attributes", all.size, size_of::<Attributes>())?;
    let (mut robot, mut threads, mut gravity) = (None, None, 0);
    for i in 0..usize::try_from(all.count).unwrap_or(0) {
        // SAFETY: there are `count` types, names and values; a text is UTF-8 of its length.
        unsafe {
            let (kind, value) = (*all.types.add(i), *all.values.add(i));
            match (text(&**all.names.add(i)), kind) {
                (Some("robot"), STRING) => robot = text(&*value.cast::<Text>()),
                (Some("threads"), SCALAR) => threads = whole(&*value.cast::<Number>()),
                (Some("gravity"), SCALAR) => {
                    gravity = whole(&*value.cast::<Number>()).unwrap_or(0);
                }
                _ => {}
            }
        }
    }
    match (robot, threads.map(usize::try_from)) {
        (Some(robot), Some(Ok(threads))) => Ok((robot, threads, gravity != 0)),
        _ => Err(invalid("a call without its attributes robot and threads")),
    }
}

/// A number of type i64.
///
/// # Safety
/// The number must be of its type.
unsafe fn whole(number: &Number) -> Option<i64> {
    // SAFETY: as the function's own.
    (number.kind == I64).then(|| unsafe { *number.value.cast::<i64>() })
}

/// # Safety
/// The text must have its length.
unsafe fn text(text: &Text) -> Option<&str> {
    if text.length == 0 {
        return Some(""); // its start may be null
    }
    // SAFETY: as the function's own.
    let bytes = unsafe { slice::from_raw_parts(text.start, text.length) };
    std::str::from_utf8(bytes).ok()
}

impl Buffer {
    /// Number of entries.
    fn numbers(&self) -> usize {
        let rank = usize::try_from(self.rank).unwrap_or(0);
        if rank == 0 {
            return 1;
        }
        // SAFETY: a buffer has as many dimensions as its rank says.
        let dimensions = unsafe { slice::from_raw_parts(self.dimensions, rank) };
        let sizes = dimensions.iter().map(|d| usize::try_from(*d).unwrap_or(0));
        sizes.product()
    }

    fn check<T>(&self, name: &str, kind: i32, count: usize) -> Result<(), Failure> {
        if self.kind != kind || self.numbers() != count {
            let (of, have) = (self.kind, self.numbers());
            return Err(invalid(format!(
                "{name} has {have} entries of type {of}, it must have {count} of type {kind}"
            )));
        }
        if count > 0 && !self.data.cast::<T>().is_aligned() {
            return Err(invalid(format!("{name} is not aligned")));
        }
        Ok(())
    }

    /// # Safety
    /// The memory of the buffer must be filled and must not change.
    unsafe fn read(&self, name: &str, count: usize) -> Result<&[f64], Failure> {
        self.check::<f64>(name, F64, count)?;
        Ok(match count {
            0 => &[],
            // SAFETY: the buffer has so many numbers of this type.
            _ => unsafe { slice::from_raw_parts(self.data.cast(), count) },
        })
    }

    /// # Safety
    /// The memory of the buffer must be used by nobody else.
    unsafe fn write<T: Copy>(&self, name: &str, kind: i32, values: &[T]) -> Result<(), Failure> {
        self.check::<T>(name, kind, values.len())?;
        if !values.is_empty() {
            // SAFETY: the buffer has place for so many values of this type.
            unsafe {
                self.data
                    .cast::<T>()
                    .copy_from_nonoverlapping(values.as_ptr(), values.len());
            }
        }
        Ok(())
    }
}
