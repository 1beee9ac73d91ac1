//! `bowstring-bindgen INPUT.wasm FOLDER`: JavaScript and types beside the module, and the module compressed.

use std::path::Path;
use std::process::ExitCode;
use std::{fs, io};
use wasm_bindgen_cli_support::Bindgen;

/// The module repeats itself over longer distances than gzip looks back: a third less than by gzip.
const LEVEL: i32 = 22;

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let [input, folder] = arguments.as_slice() else {
        eprintln!("usage: bowstring-bindgen INPUT.wasm FOLDER");
        return ExitCode::from(2);
    };
    let mut bindgen = Bindgen::new();
    bindgen.input_path(input).typescript(true);
    let written = bindgen.web(true).and_then(|bindgen| bindgen.generate(folder));
    if let Err(error) = written {
        eprintln!("{input}: {error:#}");
        return ExitCode::FAILURE;
    }
    if let Err(error) = pack(Path::new(folder)) {
        eprintln!("{folder}: {error}");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

fn pack(folder: &Path) -> io::Result<()> {
    let module = fs::read(folder.join("bowstring_wasm_bg.wasm"))?;
    fs::write(folder.join("core.bin"), zstd::bulk::compress(&module, LEVEL)?)
}
