//! Tests of clocks on simulated boards: set, read back, lowered, restored.

use super::*;
use crate::scheduler::sysfs::tests::Tree;

const POLICY: &str = "devices/system/cpu/cpufreq/policy0";
const ORIN_GPU: &str = "class/devfreq/17000000.gpu";
const GBUS: &str = "kernel/debug/clock";

fn file(folder: &str, name: &str) -> String {
    format!("{folder}/{name}")
}

/// An Orin: one cpufreq policy without a list of steps, its GPU in devfreq.
fn orin() -> Tree {
    let tree = Tree::new(&[]);
    for (name, value) in [
        ("scaling_min_freq", "115200"),
        ("scaling_max_freq", "1510400"),
        ("scaling_cur_freq", "729600"),
        ("cpuinfo_min_freq", "115200"),
        ("cpuinfo_max_freq", "1510400"),
    ] {
        tree.set(&file(POLICY, name), value);
    }
    for (name, value) in [
        ("min_freq", "306000000"),
        ("max_freq", "624750000"),
        ("cur_freq", "306000000"),
        ("available_frequencies", "306000000 408000000 510000000 624750000"),
    ] {
        tree.set(&file(ORIN_GPU, name), value);
    }
    tree.set("class/devfreq/15340000.vic/min_freq", "1");
    tree
}

/// The paper's board: cores of an old kernel, the GPU in debugfs.
fn tk1() -> Tree {
    let tree = Tree::new(&[("devices/system/cpu/cpuquiet/tegra_cpuquiet/enable", "1")]);
    for core in 0..4 {
        for (name, value) in [
            ("scaling_min_freq", "204000"),
            ("scaling_max_freq", "2320500"),
            ("scaling_cur_freq", "204000"),
            ("scaling_available_frequencies", "204000 696000 1092000 1204500 2320500"),
        ] {
            tree.set(&format!("devices/system/cpu/cpu{core}/cpufreq/{name}"), value);
        }
    }
    tree.set("devices/system/cpu/cpuidle/current_driver", "none");
    tree.set(&file(GBUS, "override.gbus/rate"), "72000000");
    tree.set(&file(GBUS, "override.gbus/state"), "0");
    tree.set(&file(GBUS, "gbus/rate"), "72000000");
    let steps = "72000 108000 180000 252000 324000 396000 468000 540000 612000 648000 684000 708000 756000 804000 852000";
    tree.set(&file(GBUS, "gbus/possible_rates"), steps);
    tree
}

#[test]
fn steps_of_the_gpu_are_read_from_devfreq_and_debugfs() {
    let mut board = config::load(None).unwrap().board;
    let steps = |board: &config::Board| {
        let (name, steps) = gpu_steps(board)?;
        Some((name, steps.len(), steps.first()?.mhz(), steps.last()?.mhz()))
    };
    let (orin, tk1) = (orin(), tk1());
    board.sysfs = orin.0.path().to_owned();
    assert_eq!(steps(&board), Some(("17000000.gpu".into(), 4, 306.0, 624.75)));
    orin.remove(&file(ORIN_GPU, "available_frequencies"));
    assert_eq!(steps(&board), None);
    board.sysfs = tk1.0.path().to_owned();
    assert_eq!(steps(&board), None, "the GPU is not in devfreq");
    board.gpu = "tk1".into();
    assert_eq!(steps(&board), Some(("gbus".into(), 15, 72.0, 852.0)));
}

fn settings(cpu: f64, gpu: f64) -> ClockSettings {
    let some = |mhz: f64| (mhz > 0.0).then(|| Hertz::from_mhz(mhz));
    ClockSettings {
        cpu: some(cpu),
        gpu: some(gpu),
        gpu_by_override: false,
        gpu_device: "*gpu*,*ga10b".into(),
        needs_all: true,
    }
}

fn snapshot(tree: &Tree) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    let mut open = vec![tree.0.path().to_owned()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else {
                files.push((path.clone(), std::fs::read_to_string(path).unwrap().trim().to_owned()));
            }
        }
    }
    files.sort();
    files
}

#[test]
fn clocks_are_set_read_back_and_restored() {
    let tree = orin();
    let before = snapshot(&tree);
    let state = tempfile::tempdir().unwrap();
    let kept = state_file(state.path());
    let mut clocks = Clocks::take(&tree.sysfs(), &settings(1510.4, 625.0), &kept).unwrap();
    for (folder, low, high, value) in [
        (POLICY, "scaling_min_freq", "scaling_max_freq", "1510400"),
        (ORIN_GPU, "min_freq", "max_freq", "624750000"),
    ] {
        assert_eq!(
            (tree.get(&file(folder, low)), tree.get(&file(folder, high))),
            (value.into(), value.into())
        );
    }
    assert!(kept.exists());
    // The setting has no effect on the cores.
    tree.set(&file(ORIN_GPU, "cur_freq"), "624750000");
    clocks.check();
    assert_eq!(clocks.fault(), None, "one or two low readings are no fault");
    clocks.check();
    assert_eq!(clocks.fault().as_deref(), Some("clock policy0 runs at 730 MHz, set to 1510 MHz"));
    tree.set(&file(POLICY, "scaling_cur_freq"), "1510400");
    clocks.check();
    assert_eq!(clocks.fault(), None);
    let read: Vec<_> = clocks.readings().map(|(name, _, read)| (name.to_owned(), read)).collect();
    assert_eq!(
        read,
        [
            ("policy0".to_owned(), Some(Hertz(1_510_400_000))),
            ("17000000.gpu".to_owned(), Some(Hertz(624_750_000)))
        ]
    );
    // The GPU is throttled, or its file is missing.
    tree.set(&file(ORIN_GPU, "cur_freq"), "510000000");
    (0..3).for_each(|_| clocks.check());
    assert_eq!(clocks.fault().as_deref(), Some("clock 17000000.gpu runs at 510 MHz, set to 625 MHz"));
    tree.remove(&file(ORIN_GPU, "cur_freq"));
    clocks.check();
    assert_eq!(clocks.fault().as_deref(), Some("clock 17000000.gpu cannot be read back"));
    // Lower: steps are rounded down.
    clocks.set(0.7).unwrap();
    assert_eq!(tree.get(&file(ORIN_GPU, "max_freq")), "408000000");
    assert_eq!(tree.get(&file(ORIN_GPU, "min_freq")), "408000000");
    assert_eq!(tree.get(&file(POLICY, "scaling_max_freq")), "1057280");
    drop(clocks);
    assert!(!kept.exists());
    tree.set(&file(ORIN_GPU, "cur_freq"), "306000000");
    tree.set(&file(POLICY, "scaling_cur_freq"), "729600");
    assert_eq!(snapshot(&tree), before);
}

#[test]
fn the_gpu_clocks_of_the_paper_are_steps_of_its_board() {
    // The paper's table: stereo in ms at 24 pairs a second, three runs each.
    for (mhz, stereo_ms) in [(324, [96, 93, 96]), (648, [58, 57, 59]), (852, [55, 50, 52])] {
        let tree = tk1();
        let before = snapshot(&tree);
        let state = tempfile::tempdir().unwrap();
        let settings = ClockSettings { gpu_by_override: true, ..settings(1204.5, f64::from(mhz)) };
        let mut clocks = Clocks::take(&tree.sysfs(), &settings, &state_file(state.path())).unwrap();
        assert_eq!(tree.get(&file(GBUS, "override.gbus/rate")), format!("{mhz}000000"), "{stereo_ms:?}");
        assert_eq!(tree.get(&file(GBUS, "override.gbus/state")), "1");
        assert_eq!(tree.get("devices/system/cpu/cpuquiet/tegra_cpuquiet/enable"), "0");
        for core in 0..4 {
            let folder = format!("devices/system/cpu/cpu{core}/cpufreq");
            assert_eq!(tree.get(&file(&folder, "scaling_min_freq")), "1204500");
            // As the kernel does.
            tree.set(&file(&folder, "scaling_cur_freq"), "1204500");
        }
        tree.set(&file(GBUS, "gbus/rate"), &format!("{mhz}000000"));
        (0..3).for_each(|_| clocks.check());
        assert_eq!(clocks.fault(), None);
        // The hot rung takes the next step below.
        clocks.set(0.6).unwrap();
        let lowered = clocks.readings().last().map(|(_, target, _)| target);
        let expected = match mhz {
            324 => 180,
            648 => 324,
            _ => 468,
        };
        assert_eq!(lowered, Some(Hertz(expected * 1_000_000)));
        drop(clocks);
        for core in 0..4 {
            tree.set(&format!("devices/system/cpu/cpu{core}/cpufreq/scaling_cur_freq"), "204000");
        }
        tree.set(&file(GBUS, "gbus/rate"), "72000000");
        assert_eq!(snapshot(&tree), before);
    }
}

#[test]
fn the_next_run_restores_the_clocks_of_a_killed_one() {
    let tree = orin();
    let before = snapshot(&tree);
    let state = tempfile::tempdir().unwrap();
    let kept = state_file(state.path());
    // Killed: no drop.
    std::mem::forget(Clocks::take(&tree.sysfs(), &settings(1000.0, 408.0), &kept).unwrap());
    assert_ne!(snapshot(&tree), before);
    // The next run must not save the fixed clocks as the original ones.
    let clocks = Clocks::take(&tree.sysfs(), &settings(800.0, 0.0), &kept).unwrap();
    assert_eq!(tree.get(&file(ORIN_GPU, "max_freq")), "624750000");
    drop(clocks);
    assert_eq!(snapshot(&tree), before);
    // Without another run, restore-clocks restores them.
    std::mem::forget(Clocks::take(&tree.sysfs(), &settings(1000.0, 408.0), &kept).unwrap());
    assert_eq!(restore(&tree.sysfs(), &kept).unwrap(), Some(2));
    assert_eq!(snapshot(&tree), before);
    assert_eq!(restore(&tree.sysfs(), &kept).unwrap(), None);
}

#[test]
fn a_state_file_can_name_nothing_but_clocks() {
    let tree = orin();
    let before = snapshot(&tree);
    let state = tempfile::tempdir().unwrap();
    let kept = state_file(state.path());
    for hostile in [
        r#"[{"kind":"DevFreq","name":"../../etc","values":[1,2]}]"#,
        r#"[{"kind":"DevFreq","name":"..","values":[1,2]}]"#,
        r#"[{"kind":"DevFreq","name":"","values":[1,2]}]"#,
        r#"[{"kind":"DevFreq","name":"17000000.gpu","values":[1]}]"#,
        r#"[{"kind":"DevFreq","name":"17000000.gpu","values":[2,1]}]"#,
        r#"[{"kind":"DevFreq","name":"17000000.gpu","values":[-1,1.5]}]"#,
        r#"[{"kind":"CpuFreq","name":"policy0/../../x","values":[1,2]}]"#,
        r#"[{"kind":"CpuFreq","name":"policy","values":[1,2]}]"#,
        r#"[{"kind":"CpuFreq","name":"cpufreq","values":[1,2]}]"#,
        r#"[{"kind":"Override","name":"emc","values":[1,1]}]"#,
        r#"[{"kind":"Override","name":"gbus","values":[1,2]}]"#,
        r#"[{"kind":"CpuQuiet","name":"balanced","values":[1]}]"#,
        r#"[{"kind":"CpuQuiet","name":"tegra_cpuquiet","values":[7]}]"#,
        r#"[{"kind":"Shell","name":"x","values":[1]}]"#,
        "no JSON",
    ] {
        std::fs::write(&kept, hostile).unwrap();
        let error = restore(&tree.sysfs(), &kept).unwrap_err().to_string();
        assert!(error.contains("clocks.json") && error.contains("not known"), "{error}");
        assert!(Clocks::take(&tree.sysfs(), &settings(800.0, 0.0), &kept).is_err());
    }
    // A missing device is an error, and the file is kept.
    std::fs::write(&kept, r#"[{"kind":"DevFreq","name":"gone.gpu","values":[1,2]}]"#).unwrap();
    assert!(restore(&tree.sysfs(), &kept).unwrap_err().to_string().contains("gone.gpu"));
    assert!(kept.exists());
    assert_eq!(snapshot(&tree), before);
}

#[test]
fn values_are_restored_within_the_limits_of_the_device() {
    let (orin, tk1) = (orin(), tk1());
    let state = tempfile::tempdir().unwrap();
    let kept = state_file(state.path());
    let put_back = |tree: &Tree, text: &str| {
        std::fs::write(&kept, text).unwrap();
        assert_eq!(restore(&tree.sysfs(), &kept).unwrap(), Some(1));
    };
    put_back(&orin, r#"[{"kind":"CpuFreq","name":"policy0","values":[1,9000000]}]"#);
    assert_eq!(orin.get(&file(POLICY, "scaling_min_freq")), "115200");
    assert_eq!(orin.get(&file(POLICY, "scaling_max_freq")), "1510400");
    put_back(&orin, r#"[{"kind":"DevFreq","name":"17000000.gpu","values":[0,18446744073709551615]}]"#);
    assert_eq!(orin.get(&file(ORIN_GPU, "min_freq")), "0", "no limit");
    assert_eq!(orin.get(&file(ORIN_GPU, "max_freq")), "624750000");
    put_back(&tk1, r#"[{"kind":"Override","name":"gbus","values":[9000000000,1]}]"#);
    assert_eq!(tk1.get(&file(GBUS, "override.gbus/rate")), "852000000");
    put_back(&tk1, r#"[{"kind":"CpuFreq","name":"cpu3","values":[1,9000000]}]"#);
    assert_eq!(tk1.get("devices/system/cpu/cpu3/cpufreq/scaling_max_freq"), "2320500");
}

#[test]
fn only_a_regular_file_that_nobody_else_can_write_is_obeyed() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let tree = orin();
    let before = snapshot(&tree);
    let state = tempfile::tempdir().unwrap();
    let kept = state_file(state.path());
    let refused = |words: &str| {
        let error = restore(&tree.sysfs(), &kept).unwrap_err().to_string();
        assert!(error.contains("clocks.json") && error.contains(words), "{error}");
        assert!(std::fs::symlink_metadata(&kept).is_ok(), "it is kept");
        assert_eq!(snapshot(&tree), before);
    };
    let valid = r#"[{"kind":"CpuFreq","name":"policy0","values":[204000,408000]}]"#;
    let elsewhere = state.path().join("elsewhere");
    std::fs::write(&elsewhere, valid).unwrap();
    symlink(&elsewhere, &kept).unwrap();
    refused("symbolic links");
    std::fs::remove_file(&kept).unwrap();
    // A pipe that nobody writes.
    let mode = rustix::fs::Mode::from_raw_mode(0o600);
    rustix::fs::mknodat(rustix::fs::CWD, &kept, rustix::fs::FileType::Fifo, mode, 0).unwrap();
    refused("no regular file");
    std::fs::remove_file(&kept).unwrap();
    std::fs::write(&kept, valid).unwrap();
    std::fs::set_permissions(&kept, PermissionsExt::from_mode(0o666)).unwrap();
    refused("only the owner");
    std::fs::write(&kept, vec![b' '; 100_000]).unwrap();
    std::fs::set_permissions(&kept, PermissionsExt::from_mode(0o600)).unwrap();
    refused("at most 65536");
    std::fs::write(&kept, valid).unwrap();
    std::fs::set_permissions(state.path(), PermissionsExt::from_mode(0o777)).unwrap();
    refused("only the owner");
    std::fs::set_permissions(state.path(), PermissionsExt::from_mode(0o700)).unwrap();
    assert_eq!(restore(&tree.sysfs(), &kept).unwrap(), Some(1));
    // What is laid where the file is written is replaced, not followed.
    std::fs::write(&elsewhere, "precious").unwrap();
    symlink(&elsewhere, kept.with_extension("new")).unwrap();
    drop(Clocks::take(&tree.sysfs(), &settings(800.0, 0.0), &kept).unwrap());
    assert_eq!(std::fs::read_to_string(&elsewhere).unwrap(), "precious");
}

#[test]
fn a_board_without_the_gpu_still_has_its_cores_set() {
    let state = tempfile::tempdir().unwrap();
    let kept = state_file(state.path());
    let tree = orin();
    let before = snapshot(&tree);
    let gpu_elsewhere = ClockSettings { gpu_device: "none-such".into(), ..settings(800.0, 408.0) };
    let error = Clocks::take(&tree.sysfs(), &gpu_elsewhere, &kept).unwrap_err().to_string();
    assert!(error.contains("no gpu clock"), "{error}");
    assert_eq!(snapshot(&tree), before, "a needed clock is missing: nothing is changed");
    let preferred = ClockSettings { needs_all: false, ..gpu_elsewhere };
    let clocks = Clocks::take(&tree.sysfs(), &preferred, &kept).unwrap();
    assert_ne!(snapshot(&tree), before, "the cores are set");
    assert!(clocks.readings().count() >= 1);
    let fault = clocks.fault().unwrap_or_default();
    assert!(fault.contains("no gpu clock") && fault.contains("clocks.gpu_mhz to 0"), "{fault}");
    drop(clocks);
    assert_eq!(snapshot(&tree), before, "restored");
    // Nothing to set at all is told as an error.
    let only_gpu = ClockSettings { cpu: None, ..preferred };
    assert!(Clocks::take(&tree.sysfs(), &only_gpu, &kept).is_err() && !kept.exists());
}

#[test]
fn missing_clocks_and_refusals_say_what_to_do() {
    let state = tempfile::tempdir().unwrap();
    let kept = state_file(state.path());
    let empty = Tree::new(&[]);
    let error = Clocks::take(&empty.sysfs(), &settings(800.0, 0.0), &kept).unwrap_err().to_string();
    assert!(error.contains("no cpu clock") && error.contains("clocks.cpu_mhz"), "{error}");
    let error = Clocks::take(&empty.sysfs(), &settings(0.0, 500.0), &kept).unwrap_err().to_string();
    assert!(error.contains("no gpu clock"), "{error}");
    assert!(!kept.exists());
    // A folder in place of the file makes the write fail for every user.
    let tree = orin();
    let before = snapshot(&tree);
    tree.remove(&file(POLICY, "scaling_max_freq"));
    std::fs::create_dir(tree.0.path().join(file(POLICY, "scaling_max_freq"))).unwrap();
    let error = Clocks::take(&tree.sysfs(), &settings(800.0, 408.0), &kept).unwrap_err().to_string();
    assert!(error.contains("scaling_max_freq") && error.contains("docs/operations.md"), "{error}");
    std::fs::remove_dir(tree.0.path().join(file(POLICY, "scaling_max_freq"))).unwrap();
    tree.set(&file(POLICY, "scaling_max_freq"), "1510400");
    assert_eq!(snapshot(&tree), before, "nothing was changed");
    // A frequency below the slowest step gives the slowest step.
    let clocks = Clocks::take(&tree.sysfs(), &settings(0.0, 10.0), &kept).unwrap();
    assert_eq!(clocks.readings().next().map(|c| c.1), Some(Hertz(306_000_000)));
    // A frequency above the fastest step is a fault.
    drop(clocks);
    tree.set(&file(ORIN_GPU, "cur_freq"), "624750000");
    let mut clocks = Clocks::take(&tree.sysfs(), &settings(0.0, 900.0), &kept).unwrap();
    (0..3).for_each(|_| clocks.check());
    assert_eq!(clocks.fault().as_deref(), Some("clock 17000000.gpu runs at 625 MHz, set to 900 MHz"));
}
