//! Inputs of a size that no real one has: each is refused with its limit and a remedy, and without the memory that it
//! would take. The commands run with an address space of 1.5 GiB.

use crate::support::Bench;
use std::fs::File;
use std::process::Command;

/// Address space of a command, in KiB. A scene with 10,000 rows took 5.8 GB.
const ADDRESS_SPACE_KIB: u64 = 1_500_000;

/// Runs a command that must fail, and checks what it says.
fn refused(bench: &Bench, args: &[&str], expected: &str) {
    let shell = format!("ulimit -v {ADDRESS_SPACE_KIB} && exec \"$0\" \"$@\"");
    let output = Command::new("sh")
        .args(["-c", &shell, env!("CARGO_BIN_EXE_lookout")])
        .args(args)
        .current_dir(bench.folder.path())
        .output()
        .expect("the binary runs");
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{args:?}: {error}");
    assert!(error.contains(expected), "{args:?}: {error}\nexpected {expected}");
    assert!(error.len() < 20_000, "{args:?}: an error of {} bytes", error.len());
}

#[test]
fn configurations() {
    let bench = Bench::new();
    let keys: String = (0..7_000_000).map(|i| format!("k{i}=1\n")).collect();
    std::fs::write(bench.path("keys.toml"), keys).unwrap();
    refused(
        &bench,
        &["check-config", "keys.toml"],
        "bytes: a configuration has at most 262144; give a TOML file",
    );
    std::fs::write(bench.path("open.toml"), "[".repeat(100_000_000)).unwrap();
    refused(
        &bench,
        &["check-config", "open.toml"],
        "open.toml: 100000000 bytes: a configuration has at most",
    );
}

#[test]
fn scenes() {
    let bench = Bench::new();
    let start = "title = \"x\"\nseconds = 2\n";
    let row = "[[beside]]\nkind = \"trees\"\nlateral_m = 9\nto_m = 5000\n";
    std::fs::write(bench.path("rows.toml"), format!("{start}{}", row.repeat(10_000))).unwrap();
    let replay = |name| ["replay", name, "--in-process", "--out", "out"];
    refused(
        &bench,
        &replay("scene:rows.toml"),
        "with those of 10000 rows beside the road: a scene has at most 5000; give fewer",
    );
    let object = "[[objects]]\nkind = \"car\"\nalong_m = 9\n";
    std::fs::write(bench.path("objects.toml"), format!("{start}{}", object.repeat(100_000))).unwrap();
    refused(
        &bench,
        &replay("scene:objects.toml"),
        "objects.toml: 3700024 bytes: a scene has at most 1048576",
    );
}

#[test]
fn cascades_calibrations_and_images() {
    let bench = Bench::new();
    let picture = image::GrayImage::new(64, 48);
    picture.save(bench.path("picture.png")).unwrap();
    let attributes: String = (0..300_000).map(|i| format!(" a{i}=\"\"")).collect();
    std::fs::write(bench.path("wide.xml"), format!("<opencv_storage{attributes}></opencv_storage>")).unwrap();
    let detect = |cascade, picture| ["detect", cascade, picture];
    refused(&bench, &detect("wide.xml", "picture.png"), "bytes in a tag: a cascade has at most 1024; give");
    for (name, bytes) in [("large.xml", 1_u64 << 40), ("large.toml", 1 << 40), ("large.png", 1 << 40)] {
        // A hole on disk.
        File::create(bench.path(name)).unwrap().set_len(bytes).unwrap();
    }
    refused(&bench, &detect("large.xml", "picture.png"), "1099511627776 bytes: a cascade has at most");
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/vehicle.xml");
    refused(
        &bench,
        &detect(shipped, "large.png"),
        "1099511627776 bytes: an image has at most 134217728; give",
    );
    refused(&bench, &["rig", "large.toml"], "1099511627776 bytes: a calibration has at most");
}
