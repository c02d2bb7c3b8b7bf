//! Prints the Debian package's `copyright`: the project's own terms, and those of every crate and C library that is
//! linked into the program. `systemd/package.sh` calls it:
//!
//! ```sh
//! cargo run --release --locked -p debian-copyright -- --target aarch64-unknown-linux-gnu [--features LIST]
//! ```

mod crates;
mod notices;

use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let (mut target, mut features) = (None, String::new());
    while let Some(argument) = arguments.next() {
        match (argument.as_str(), arguments.next()) {
            ("--target", Some(value)) => target = Some(value),
            ("--features", Some(value)) => features = value,
            _ => target = None,
        }
    }
    let Some(target) = target else {
        eprintln!("usage: debian-copyright --target TRIPLE [--features LIST]");
        return ExitCode::from(2);
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    match crates::linked(&root, &target, &features).and_then(|linked| notices::document(&root, &linked)) {
        Ok(text) => {
            print!("{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("debian-copyright: {error}");
            ExitCode::FAILURE
        }
    }
}
