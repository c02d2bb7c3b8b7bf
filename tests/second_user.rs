//! What another user of the machine can do to the daemon: nothing but fill /dev/shm. SECURITY.md lists the promises.
//!
//! The other user is number 65534, in a mount namespace with a /dev/shm and a /tmp of its own. Each attack succeeded
//! once.

use crate::support::{Bench, Need, WATCHDOG, pid_of, send, skip};
use serde_json::Value;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A mount namespace in which root runs the daemon, and a second user attacks it.
struct Machine {
    bench: Bench,
    /// Holds the namespace.
    holder: Child,
}

impl Machine {
    /// `None`, and the test is skipped, where this process is not root or may not create namespaces.
    fn new() -> Option<Self> {
        let bench = Bench::new();
        let mount = "mount -t tmpfs -o mode=1777 tmpfs /dev/shm && mount -t tmpfs -o mode=1777 tmpfs /tmp";
        let possible = rustix::process::geteuid().is_root()
            && Command::new("unshare")
                .args(["--mount", "--propagation", "private", "sh", "-c"])
                .arg(format!("{mount} && setpriv --reuid 65534 --regid 65534 --clear-groups true"))
                .stderr(Stdio::null())
                .status()
                .is_ok_and(|status| status.success());
        if !possible {
            skip(Need::Namespaces, "a second user needs root, mount namespaces and setpriv");
            return None;
        }
        let mut holder = Command::new("unshare");
        holder.args(["--mount", "--propagation", "private", "sh", "-c"]);
        holder.arg(format!("{mount} && echo ready && exec sleep 1000")).stdout(Stdio::piped());
        let mut holder = holder.spawn().expect("unshare runs");
        let mut ready = [0; 6];
        std::io::Read::read_exact(holder.stdout.as_mut().expect("a pipe"), &mut ready).expect("it is ready");
        let machine = Self { bench, holder };
        let text = "[source]\nkind = \"scene\"\n[stereo]\ndisparities = 32\n[supervision]\nheartbeat_ms = 50\n\
                    restart_first_ms = 50\nrestart_longest_ms = 200\nrestart_count = 100\n";
        std::fs::write(machine.path("/tmp/car.toml"), text).expect("the configuration is written");
        Some(machine)
    }

    /// A path of the namespace, as seen from outside.
    fn path(&self, inside: &str) -> PathBuf {
        PathBuf::from(format!("/proc/{}/root{inside}", self.holder.id()))
    }

    fn enter(&self) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["--mount", "--target", &self.holder.id().to_string()]);
        command
    }

    /// `lookout`, as root.
    fn lookout(&self, args: &[&str]) -> Command {
        let inner = self.bench.command(args);
        let mut command = self.enter();
        // By way of this process: the namespace has a /tmp of its own, and the program may lie below the machine's.
        let program = format!("/proc/{}/root{}", std::process::id(), inner.get_program().display());
        command.arg(program).args(args).args(["-c", "/tmp/car.toml"]);
        command
    }

    fn start(&self, args: &[&str]) -> Running {
        let mut command = self.lookout(args);
        Running(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it starts"))
    }

    /// A command of the shell, as the second user.
    fn second_user(&self, script: &str) -> Command {
        let mut command = self.enter();
        command.args([
            "setpriv",
            "--reuid",
            "65534",
            "--regid",
            "65534",
            "--clear-groups",
            "sh",
            "-c",
            script,
        ]);
        command
    }

    fn attack(&self, script: &str) -> Output {
        self.second_user(script).output().expect("setpriv runs")
    }

    /// An attack that goes on.
    fn attacker(&self, script: &str) -> Child {
        self.second_user(script).stderr(Stdio::null()).spawn().expect("setpriv runs")
    }

    fn attack_succeeds(&self, script: &str) {
        let output = self.attack(script);
        assert!(output.status.success(), "{script}: {}", String::from_utf8_lossy(&output.stderr));
    }

    fn status_when(&self, wanted: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let output = self.lookout(&["status", "--json"]).output().expect("it runs");
            let status = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
            if output.status.success() && wanted(&status) {
                return status;
            }
            let errors = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(start.elapsed() < WATCHDOG, "the wanted status never came: {errors}\n{status}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn running(&self) -> Value {
        self.status_when(|s| s["state"] == "running" && s["frames"].as_u64() > Some(3))
    }

    /// Names in shared memory.
    fn shared(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.path("/dev/shm")).expect("/dev/shm").flatten();
        entries.filter_map(|e| e.file_name().into_string().ok()).collect()
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = self.holder.kill();
        let _ = self.holder.wait();
    }
}

/// A daemon, which is killed if its test ends early.
struct Running(Child);

impl Running {
    /// Asks it to stop; it has to succeed.
    fn stop(mut self) {
        send(self.0.id(), "TERM");
        let start = Instant::now();
        while self.0.try_wait().expect("it can be waited for").is_none() {
            assert!(start.elapsed() < WATCHDOG, "SIGTERM was not heard");
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(self.0.wait().expect("it has ended").success());
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_second_user_cannot_open_lock_or_change_any_file_of_a_run() {
    let Some(machine) = Machine::new() else { return };
    let daemon = machine.start(&["run"]);
    let status = machine.running();
    // What `status` has used is removed in a moment; an attack would create a file in its place.
    std::thread::sleep(Duration::from_millis(500));
    let files = machine.shared();
    assert!(files.iter().any(|name| name.ends_with("global_mgmt")), "{files:?}");
    for name in files.iter().filter(|name| name.starts_with("lookout.")) {
        for attack in ["truncate -s 0", "cat", "flock -s -n", "rm -f", "tee -a"] {
            let tail = if attack.starts_with("flock") { "true" } else { "< /dev/null" };
            let output = machine.attack(&format!("{attack} '/dev/shm/{name}' {tail}"));
            assert!(!output.status.success(), "{attack} {name}");
        }
    }
    assert!(!machine.attack("ls /tmp/lookout-0/").status.success());
    // The scheduler opens the node counter when a stage has died.
    send(pid_of(&status, "road"), "KILL");
    let road = pid_of(&status, "road");
    machine.status_when(|s| s["state"] == "running" && pid_of(s, "road") != road && pid_of(s, "road") != 0);
    daemon.stop();
    assert_eq!(machine.shared(), Vec::<String>::new());
}

#[test]
fn a_second_user_is_told_whose_daemon_runs_and_how_to_see_it() {
    let Some(machine) = Machine::new() else { return };
    let daemon = machine.start(&["run"]);
    machine.running();
    // The second user need not reach the folder of this build.
    std::fs::copy(env!("CARGO_BIN_EXE_lookout"), machine.path("/tmp/lookout"))
        .expect("the program is copied");
    let output = machine.attack("/tmp/lookout status");
    daemon.stop();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    let told = "user root (0) runs daemons in /tmp/lookout-0: see it with sudo -u root lookout status";
    assert!(output.status.code() == Some(1) && text.contains(told), "{text}");
}

#[test]
fn what_a_second_user_leaves_in_shared_memory_neither_blocks_a_start_nor_removes_a_live_run() {
    let Some(machine) = Machine::new() else { return };
    let first = machine.start(&["run"]);
    let before = machine.running();
    // Marks of runs that never were: a FIFO blocks who opens it for reading; an empty prefix stands for all runs; the
    // mark of a live run is known to everybody.
    machine.attack_succeeds(
        "cd /dev/shm && mkfifo -m 644 lookout.x.run lookout.aaaaaaaaaaaa.run lookout.aaaaaaaaaaaa.data \
         && touch lookout.run lookout..run lookout.bbbbbbbbbbbb.run lookout.bbbbbbbbbbbb.data \
         && ln -s /etc/passwd lookout.cccccccccccc.run \
         && for mark in lookout.????????????.run; do mkfifo -m 666 ${mark%run}zz; ln -s /tmp/car.toml ${mark%run}new; done",
    );
    let second = machine.start(&["run", "--instance", "second"]);
    machine.running();
    let start = Instant::now();
    loop {
        let output =
            machine.lookout(&["status", "--json", "--instance", "second"]).output().expect("it runs");
        let status = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        if status["state"] == "running" {
            break;
        }
        assert!(start.elapsed() < WATCHDOG, "the second run never came");
        std::thread::sleep(Duration::from_millis(50));
    }
    second.stop();
    // The first still has its shared memory: a stage that dies is replaced.
    let stereo = pid_of(&before, "stereo");
    send(stereo, "KILL");
    let after =
        machine.status_when(|s| s["state"] == "running" && ![0, stereo].contains(&pid_of(s, "stereo")));
    assert_eq!(pid_of(&after, "scheduler"), pid_of(&before, "scheduler"));
    first.stop();
    // What is not ours stays, and nothing of ours does.
    let owner =
        |name: &String| std::fs::symlink_metadata(machine.path("/dev/shm").join(name)).expect("a file").uid();
    assert!(machine.shared().len() >= 10, "{:?}", machine.shared());
    assert!(machine.shared().iter().all(|name| owner(name) == 65534), "{:?}", machine.shared());
    machine.attack_succeeds("rm /dev/shm/lookout.*");
    assert_eq!(machine.shared(), Vec::<String>::new());
}

#[test]
fn links_and_folders_of_a_second_user_are_refused_and_nothing_is_created_behind_them() {
    let Some(machine) = Machine::new() else { return };
    let victim = machine.path("/tmp/victim");
    std::fs::create_dir(&victim).expect("a folder of root");
    let set = "instance.directory=/tmp/linked/deep";
    for (attack, args) in [
        ("ln -s /tmp/victim /tmp/lookout-0", &["run"][..]),
        ("mkdir -m 777 /tmp/lookout-0", &["run"]),
        ("ln -s /tmp/victim /tmp/linked", &["run", "--set", set]),
        ("mkdir -m 777 /tmp/linked", &["run", "--set", set]),
        ("mkdir -m 777 /tmp/linked /tmp/linked/deep", &["run", "--set", set]),
    ] {
        machine.attack_succeeds(attack);
        let output = machine.lookout(args).output().expect("it runs");
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{attack}: {errors}");
        assert!(
            errors.contains("is owned by another user, writable by others, or a link"),
            "{attack}: {errors}"
        );
        assert_eq!(std::fs::read_dir(&victim).expect("a folder").count(), 0, "{attack}");
        assert_eq!(machine.shared(), Vec::<String>::new());
        machine.attack_succeeds("rm -rf /tmp/lookout-0 /tmp/linked");
    }
}

#[test]
fn a_second_user_cannot_keep_the_files_of_a_dead_run() {
    let Some(machine) = Machine::new() else { return };
    let daemon = machine.start(&["run"]);
    machine.running();
    // Whoever can open the mark can wait for a shared lock on it: when the run has died, its files look alive.
    let mut waiting =
        machine.attacker("for f in /dev/shm/lookout.*.run; do flock -s $f sleep 1000 & done; wait");
    std::thread::sleep(Duration::from_millis(500));
    drop(daemon);
    let left = machine.shared();
    assert!(left.len() > 20, "{left:?}");
    let again = machine.start(&["run"]);
    machine.running();
    assert!(machine.shared().iter().all(|name| !left.contains(name)));
    again.stop();
    assert_eq!(machine.shared(), Vec::<String>::new());
    let _ = waiting.kill();
    let _ = waiting.wait();
}
