//! Heat and clocks: the daemon on a simulated board whose sensors heat up and whose clocks ignore what is set.

use crate::support::{Bench, Need, WATCHDOG, skip};
use serde_json::Value;
use std::path::Path;
use std::time::Instant;

const TEMP: &str = "class/thermal/thermal_zone0/temp";
const POLICY: &str = "devices/system/cpu/cpufreq/policy0";

/// A board with one sensor and one clock, and a daemon that reacts quickly.
struct Board {
    bench: Bench,
}

impl Board {
    fn new(celsius: f64) -> Self {
        let board = Self { bench: Bench::new() };
        board.set("class/thermal/thermal_zone0/type", "cpu-thermal");
        board.heat(celsius);
        board.set(&format!("{POLICY}/scaling_min_freq"), "600000");
        board.set(&format!("{POLICY}/scaling_max_freq"), "2400000");
        board.set(&format!("{POLICY}/scaling_cur_freq"), "2400000");
        let switch = board.bench.path("switch-off");
        std::fs::write(&switch, format!("#!/bin/sh\necho off >>{}\n", board.off().display()))
            .expect("a script");
        let chmod = std::process::Command::new("chmod").arg("755").arg(&switch).status();
        assert!(chmod.expect("chmod runs").success());
        board.bench.configure(&format!(
            "[source]\nkind = \"scene\"\n\
             [heat]\nwatch = \"require\"\nzones = \"cpu*\"\nperiod_ms = 100\nfilter_s = 0\ndwell_s = 0.1\n\
             [clocks]\nset = \"require\"\ncpu_mhz = 2400\ncheck_ms = 100\n\
             [board]\nsysfs = \"{}\"\npower_off = \"command\"\npower_off_command = \"{}\"\n",
            board.bench.path("sys").display(),
            switch.display()
        ));
        board
    }

    /// The file that the power-off script writes.
    fn off(&self) -> std::path::PathBuf {
        self.bench.path("is-off")
    }

    fn set(&self, file: &str, text: &str) {
        let path = self.bench.path("sys").join(file);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("folders");
        // Atomically, as reads of the kernel's files are.
        let new = path.with_extension("new");
        std::fs::write(&new, format!("{text}\n")).expect("the file is written");
        std::fs::rename(&new, &path).expect("the file is put there");
    }

    fn heat(&self, celsius: f64) {
        self.set(TEMP, &format!("{:.0}", celsius * 1000.0));
    }

    fn clock(&self) -> (String, String) {
        let get = |file: &str| {
            let path = self.bench.path("sys").join(POLICY).join(file);
            std::fs::read_to_string(path).expect("the clock is there").trim().to_owned()
        };
        (get("scaling_min_freq"), get("scaling_max_freq"))
    }

    fn rung(&self, rung: &str) -> Value {
        self.bench.status_when(|s| s["heat"]["rung"] == rung)
    }
}

fn pair(low: &str, high: &str) -> (String, String) {
    (low.to_owned(), high.to_owned())
}

fn wait_for(path: &Path) {
    let start = Instant::now();
    while !path.exists() {
        assert!(start.elapsed() < WATCHDOG, "{} never came", path.display());
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
}

#[test]
fn every_rung_is_entered_reported_and_left_and_96_degrees_switch_off() {
    let board = Board::new(60.0);
    let daemon = board.bench.start(&["run"]);
    let status = board.bench.status_when(|s| s["state"] == "running");
    assert_eq!((&status["heat"]["rung"], &status["reason"]), (&"normal".into(), &"".into()));
    assert_eq!(status["heat"]["clocks"][0]["read_mhz"], 2400.0);
    assert_eq!(board.clock(), pair("2400000", "2400000"));

    board.heat(91.0);
    let status = board.rung("lower frame rate");
    assert_eq!((&status["state"], &status["heat"]["frame_rate_share"]), (&"degraded".into(), &0.5.into()));
    assert_eq!(status["reason"], "lower frame rate: cpu-thermal at 91.0 °C is above 90.0 °C");
    board.heat(92.5);
    let status = board.rung("lower clocks");
    assert_eq!(status["heat"]["clocks"][0]["wanted_mhz"], 1440.0);
    assert_eq!(board.clock(), pair("1440000", "1440000"));
    board.heat(93.5);
    let frames = board.rung("recognition off")["frames"].as_u64();
    // Obstacles are still tracked.
    board.bench.status_when(|s| s["frames"].as_u64() > frames.map(|f| f + 2));
    board.heat(94.5);
    let status = board.rung("stopped");
    let idle = |s: &Value| s["processes"].as_array().expect("processes").iter().all(|p| p["rate_hz"] == 0.0);
    let stopped = board.bench.status_when(idle);
    assert!(stopped["frames"].as_u64() >= status["frames"].as_u64());
    let table = board.bench.ok(&["status"]);
    assert!(table.contains("heat: stopped, cpu-thermal 94.5 °C\nclocks: policy0 1440 MHz"), "{table}");

    // And back to normal.
    board.heat(60.0);
    let status = board.bench.status_when(|s| s["heat"]["rung"] == "normal" && s["state"] == "running");
    let frames = status["frames"].as_u64();
    board.bench.status_when(|s| s["frames"].as_u64() > frames);
    assert_eq!(board.clock(), pair("2400000", "2400000"));
    let restarts =
        status["processes"].as_array().expect("processes").iter().map(|p| p["restarts"].as_u64()).max();
    assert_eq!(restarts, Some(Some(0)), "heat is no failure of a stage");

    assert!(!board.off().exists());
    board.heat(96.0);
    wait_for(&board.off());
    let status = board.rung("power off");
    assert_eq!(status["reason"], "power off: cpu-thermal at 96.0 °C is above 95.0 °C");
    daemon.signal("TERM");
    let output = daemon.wait();
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{log}");
    for rung in ["lower frame rate", "lower clocks", "recognition off", "stopped", "power off"] {
        assert!(log.contains(&format!("{rung}: cpu-thermal at 9")), "{rung} is not in the log:\n{log}");
    }
    assert_eq!(std::fs::read_to_string(board.off()).expect("it ran"), "off\n", "once");
    assert_eq!(board.clock(), pair("600000", "2400000"));
    board.bench.assert_clean();
}

#[test]
fn a_lost_sensor_is_extrapolated_until_the_stages_stop() {
    let board = Board::new(80.0);
    // Fast, so that the test need not wait long.
    let daemon = board.bench.start(&["run", "--set", "heat.slew_c_per_s=20"]);
    board.bench.status_when(|s| s["state"] == "running");
    std::fs::remove_file(board.bench.path("sys").join(TEMP)).expect("the sensor was there");
    let status = board.rung("stopped");
    let reason = status["reason"].as_str().expect("words");
    assert!(reason.contains("cpu-thermal cannot be read for") && reason.contains("last 80.0 °C"), "{reason}");
    assert_eq!(status["heat"]["zones"][0]["projected"], true);
    board.heat(70.0);
    board.bench.status_when(|s| s["heat"]["rung"] == "normal" && s["state"] == "running");
    assert!(!board.off().exists(), "a lost sensor alone switches nothing off");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    board.bench.assert_clean();
}

#[test]
fn a_hot_start_is_refused_and_nothing_is_touched() {
    let board = Board::new(91.0);
    let errors = board.bench.fails(&["run"]);
    assert!(errors.contains("cpu-thermal is at 91.0 °C, the daemon starts below 85.0 °C"), "{errors}");
    assert_eq!(board.clock(), pair("600000", "2400000"));
    board.bench.assert_clean();
}

#[test]
fn a_clock_that_is_not_applied_is_reported_with_both_frequencies() {
    let board = Board::new(60.0);
    board.set(&format!("{POLICY}/scaling_cur_freq"), "1000000");
    let daemon = board.bench.start(&["run"]);
    let status = board.bench.status_when(|s| s["state"] == "degraded");
    assert_eq!(status["reason"], "clock policy0 runs at 1000 MHz, set to 2400 MHz");
    let table = board.bench.ok(&["status"]);
    assert!(table.contains("clocks: policy0 2400 MHz (reads 1000)"), "{table}");
    board.set(&format!("{POLICY}/scaling_cur_freq"), "2400000");
    board.bench.status_when(|s| s["state"] == "running" && s["reason"] == "");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    board.bench.assert_clean();
}

#[test]
fn clocks_of_a_killed_daemon_are_restored() {
    let board = Board::new(60.0);
    let daemon = board.bench.start(&["run"]);
    board.bench.status_when(|s| s["state"] == "running");
    let errors = board.bench.fails(&["restore-clocks"]);
    assert!(errors.contains("is running"), "{errors}");
    daemon.signal("KILL");
    daemon.wait();
    assert_eq!(board.clock(), pair("2400000", "2400000"), "nobody could put them back");
    assert!(board.bench.ok(&["restore-clocks"]).contains("clocks restored: 1"));
    assert_eq!(board.clock(), pair("600000", "2400000"));
    assert!(board.bench.ok(&["restore-clocks"]).contains("no clocks to restore"));
    // The next run finds the board's own clocks, also when nobody has restored them.
    let daemon = board.bench.start(&["run"]);
    board.bench.status_when(|s| s["state"] == "running");
    daemon.signal("KILL");
    daemon.wait();
    let daemon = board.bench.start(&["run"]);
    board.bench.status_when(|s| s["state"] == "running");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    assert_eq!(board.clock(), pair("600000", "2400000"));
    board.bench.assert_clean();
}

/// Runs a shell script as another user without rights; returns whether that is possible and went well.
fn as_another_user(script: &str, folder: &Path) -> bool {
    std::process::Command::new("setpriv")
        .args(["--reuid", "65534", "--regid", "65534", "--clear-groups", "sh", "-euc", script])
        .current_dir(folder)
        .stderr(std::process::Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

#[test]
fn root_obeys_no_folder_that_another_user_laid_below_tmp() {
    use std::os::unix::fs::PermissionsExt;
    let board = Board::new(60.0);
    board.set(&format!("{POLICY}/cpuinfo_min_freq"), "600000");
    board.set(&format!("{POLICY}/cpuinfo_max_freq"), "2400000");
    let open = |path: &Path, mode| {
        std::fs::set_permissions(path, PermissionsExt::from_mode(mode)).expect("the mode is set");
    };
    // A /tmp of its own.
    let tmp = board.bench.path("tmp");
    std::fs::create_dir(&tmp).expect("a folder");
    open(&tmp, 0o1777);
    open(board.bench.folder.path(), 0o755);
    if !as_another_user("true", &tmp) {
        skip(Need::Namespaces, "only root can act as a second user");
        return;
    }
    let (base, name) = (format!("lookout-{}", rustix::process::getuid().as_raw()), &board.bench.instance);
    let config = |more: &str| {
        let text = format!(
            "[instance]\nname = \"{name}\"\n{more}[board]\nsysfs = \"{}\"\n",
            board.bench.path("sys").display()
        );
        std::fs::write(board.bench.path("car.toml"), text).expect("the configuration is written");
    };
    let lookout = |args: &[&str]| {
        let output = board.bench.command(args).env("TMPDIR", &tmp).output().expect("the binary runs");
        let text = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8_lossy(&text).into_owned())
    };
    let file = r#"[{"kind":"CpuFreq","name":"policy0","values":[600000,9999000]}]"#;
    let lay = format!("mkdir -p {name} && printf '%s' '{file}' >{name}/clocks.json");
    board.set(&format!("{POLICY}/scaling_max_freq"), "1200000");
    config("");
    // A folder, and a link to a folder that this user owns.
    std::fs::create_dir_all(board.bench.path("own").join(name)).expect("a folder");
    std::fs::write(board.bench.path("own").join(name).join("clocks.json"), file).expect("a file");
    for trap in [
        format!("mkdir {base} && cd {base} && {lay}"),
        format!("mkdir {base} && chmod 777 {base} && cd {base} && {lay} && chmod 777 {name}"),
        format!("ln -s ../own {base}"),
    ] {
        assert!(as_another_user(&trap, &tmp), "{trap}");
        for args in [
            &["restore-clocks"][..],
            &["status"],
            &["view", "--bind", "127.0.0.1:0"],
            &["record", "--out", "recording.mcap"],
        ] {
            let (code, text) = lookout(args);
            assert!(code == Some(1) && text.contains("is owned by another user"), "{args:?}: {text}");
        }
        assert_eq!(board.clock(), pair("600000", "1200000"), "{trap}");
        assert!(as_another_user(&format!("rm -rf {base}"), &tmp));
    }
    // A folder that the configuration names is obeyed by root, within the limits of the clock.
    assert!(as_another_user(&format!("mkdir service && cd service && {lay}"), &tmp));
    config(&format!("directory = \"{}\"\n", tmp.join("service").display()));
    let (code, text) = lookout(&["status"]);
    assert!(
        code == Some(1)
            && text.contains("runs as user")
            && text.contains("65534")
            && text.contains("sudo -u"),
        "{text}"
    );
    let (code, text) = lookout(&["restore-clocks"]);
    assert!(code == Some(0) && text.contains("clocks restored: 1"), "{text}");
    assert_eq!(board.clock(), pair("600000", "2400000"));
}
