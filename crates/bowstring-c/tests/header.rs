//! The committed header is what cbindgen makes from the sources.

use std::fs;
use std::path::Path;

#[test]
fn header_is_up_to_date() {
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(home.join("cbindgen.toml")).unwrap();
    let sources = ["status", "robot", "solver"].map(|name| format!("src/{name}.rs"));
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in &sources {
        builder = builder.with_src(home.join(source));
    }
    let mut made = vec![];
    builder.generate().unwrap().write(&mut made);
    let made = String::from_utf8(made).unwrap();
    let file = home.join("include/bowstring.h");
    if std::env::var_os("BOWSTRING_HEADER").is_some_and(|wish| wish == "write") {
        fs::write(&file, &made).unwrap();
    }
    let kept = fs::read_to_string(&file).unwrap_or_default();
    assert!(
        kept.replace("\r\n", "\n") == made,
        "include/bowstring.h is not that of the sources; BOWSTRING_HEADER=write writes it"
    );
}
