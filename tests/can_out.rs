//! CAN out: its DBC file, its errors, and (with the feature `can`) its life beside a daemon without a bus. Both `quick.rs`
//! and `bridge.rs` have this module: `.ci/run` builds `bridge` with the feature. The bus itself is tested by
//! `tests/can/out.sh`, where the kernel has vcan.

#[cfg(feature = "can")]
use crate::support::documented::Pages;
use crate::support::{Bench, python};
use std::path::Path;

#[test]
fn the_dbc_file_that_ships_is_that_of_the_defaults() {
    let bench = Bench::new();
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/can/lookout.dbc");
    assert_eq!(bench.ok(&["can", "--dbc"]), std::fs::read_to_string(shipped).expect("it ships"));
}

#[test]
fn the_dbc_file_of_a_configuration_is_read_by_cantools() {
    let bench = Bench::new();
    let Some(python) = python("cantools", "cantools") else { return };
    let keys = ["can_out.base_id=0x1abcde00", "can_out.extended_ids=true", "can_out.objects=3"];
    let set: Vec<&str> = keys.iter().flat_map(|key| ["--set", key]).collect();
    std::fs::write(bench.path("car.dbc"), bench.ok(&[&["can", "--dbc"], &set[..]].concat())).unwrap();
    let script = "
import cantools, sys
database = cantools.database.load_file(sys.argv[1], strict=True)
assert len(database.messages) == 11, database.messages
for message in database.messages:
    assert message.is_extended_frame and message.cycle_time == 50 and message.length == 8, message
    assert message.comment and all(signal.comment for signal in message.signals), message
distance = database.get_message_by_name('LookoutInfo_Object3').get_signal_by_name('Object3_Distance')
assert (distance.minimum, distance.maximum, distance.unit) == (0, 204.7, 'm'), distance
assert distance.choices == {4095: 'not available'}, distance.choices
frame = database.get_message_by_name('LookoutInfo_Object3')
assert frame.frame_id == 0x1abcde0c, hex(frame.frame_id)
";
    let path = bench.path("car.dbc");
    let output = std::process::Command::new(python).args(["-c", script]).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn what_cannot_be_sent_is_refused_with_a_remedy() {
    let bench = Bench::new();
    let error = bench.fails(&["can"]);
    assert!(error.contains("can_out.interface is empty"), "{error}");
    let error = bench.fails(&["can", "--set", "can_out.interface=can0", "--set", "can_out.base_id=0x7e0"]);
    assert!(error.contains("can_out.base_id = 0x7e0") && error.contains("diagnostics"), "{error}");
    bench.configure("[can_out]\nbase_id = 0x800\n");
    let error = bench.fails(&["check-config", "car.toml"]);
    assert!(error.contains("can_out.extended_ids"), "{error}");
}

#[cfg(not(feature = "can"))]
#[test]
fn a_build_without_the_feature_says_how_to_get_it() {
    let bench = Bench::new();
    let error = bench.fails(&["can", "--set", "can_out.interface=can0"]);
    assert!(error.contains("--features can"), "{error}");
}

#[cfg(feature = "can")]
#[test]
fn a_bus_that_is_missing_is_told_and_costs_the_daemon_nothing() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\n[can_out]\ninterface = \"nocan7\"\nperiod_ms = 10\n");
    let sender = bench.start(&["can", "-c", "car.toml"]);
    let daemon = bench.start(&["run"]);
    let told = bench.status_when(|s| s["can_out"]["failures"].as_u64() >= Some(2));
    assert_eq!((&told["can_out"]["state"], &told["can_out"]["cycles"]), (&"down".into(), &0.into()));
    assert!(told["can_out"]["reason"].as_str().is_some_and(|r| r.contains("can_out.interface")), "{told}");
    assert_eq!(told["can_out"]["pid"], sender.pid());
    let block = serde_json::json!({ "can_out": told["can_out"] });
    let missing = Pages::read(&["outputs.md", "can.md"]).missing(&block);
    assert!(missing.is_empty(), "docs/outputs.md and docs/can.md do not name {missing:?} of the status");
    let frames = told["frames"].as_u64();
    bench.status_when(|s| s["frames"].as_u64() > frames && s["state"] == "running");
    let error = bench.fails(&["can", "-c", "car.toml"]);
    assert!(error.contains("another lookout can"), "{error}");
    // The daemon ends first: what told the state of the bus goes with its folder.
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
    sender.signal("TERM");
    let output = sender.wait();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    bench.assert_clean();
}
