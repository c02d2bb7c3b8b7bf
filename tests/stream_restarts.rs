//! `lookout stream` while its daemon is killed and restarted, and which users may read its socket.

use crate::support::stream::{Stream, connect, frames};
use crate::support::{Bench, Need, WATCHDOG, skip};
use serde_json::Value;
use std::collections::BTreeSet;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::process::Command;
use std::time::Instant;

/// Restarts of the daemon. The last run ends without one.
const RESTARTS: usize = 10;

/// Whether a run is killed: eight of the ten restarts follow a crash, two an end in order.
fn is_killed(run: usize) -> bool {
    run % 4 != 3
}

/// Whether the next daemon starts only when the readers have told the end of a run; otherwise at once.
fn is_awaited(run: usize) -> bool {
    run % 3 == 1 || run > RESTARTS
}

fn is_withdrawn(lines: &[Value]) -> bool {
    lines.last().is_some_and(|line| line["withdrawn"] == true)
}

#[test]
fn ten_restarts_break_no_line_and_repeat_no_frame() {
    let bench = Bench::new();
    let socket = bench.path("socket").display().to_string();
    bench.configure(&format!("[source]\nkind = \"scene\"\nfps = 20\n[stream]\nsocket = \"{socket}\"\n"));
    // From shared memory, and through a socket that is served all the time.
    let server = bench.start(&["stream", "--serve"]);
    let readers = [Stream::start(&bench, &[]), Stream::start(&bench, &["--socket", &socket])];
    for run in 1..=RESTARTS + 1 {
        let daemon = bench.start(&["run"]);
        for reader in &readers {
            reader.when(|lines| {
                let runs: Vec<_> = frames(lines).into_iter().map(|(run, _)| run).collect();
                let last = runs.last().cloned().unwrap_or_default();
                let distinct = runs.iter().collect::<BTreeSet<_>>().len();
                distinct == run && runs.iter().filter(|run| **run == last).count() >= 5
            });
        }
        if is_killed(run) {
            daemon.signal("KILL");
            drop(daemon);
        } else {
            daemon.signal("TERM");
            assert!(daemon.wait().status.success());
        }
        if is_awaited(run) {
            for reader in &readers {
                reader.when(is_withdrawn);
            }
        }
    }
    let killed = (1..=RESTARTS).filter(|run| is_killed(*run)).count();
    let awaited = (1..=RESTARTS + 1).filter(|run| is_awaited(*run)).count();
    for reader in readers {
        let (lines, _) = reader.stop();
        assert!(lines.iter().all(Value::is_object));
        let runs: BTreeSet<_> = frames(&lines).into_iter().map(|(run, _)| run).collect();
        assert_eq!(runs.len(), RESTARTS + 1);
        // Where the next run begins at once, its first frame may overtake the withdrawal of the last.
        let ends = lines.iter().filter(|line| line["withdrawn"] == true);
        let ended: BTreeSet<_> = ends.clone().filter_map(|line| line["run"].as_str()).collect();
        assert!(ended.len() >= awaited, "{} of {} runs were withdrawn", ended.len(), runs.len());
        assert!(
            ends.clone()
                .all(|line| line["alarm"]["level"] == "off" && line["obstacles"] == Value::Array(vec![]))
        );
        println!(
            "{} lines, {} frames of {} runs, {} of them withdrawn, {killed} restarts after a kill",
            lines.len(),
            frames(&lines).len(),
            runs.len(),
            ended.len()
        );
    }
    server.signal("TERM");
    assert!(server.wait().status.success());
    bench.assert_clean();
}

/// A group that nobody is a member of.
const GROUP: u32 = 54_321;

#[test]
fn only_the_group_reads_the_socket_and_it_reads_nothing_else() {
    let bench = Bench::new();
    let as_user = |groups: &[&str], args: &[&str]| {
        let lookout = bench.command(args);
        let mut command = Command::new("setpriv");
        command.args(["--reuid", "65534", "--regid", "65534"]).args(groups).arg(lookout.get_program());
        command.args(args).current_dir("/").env_remove("RUNTIME_DIRECTORY");
        command
    };
    let nobody = ["--clear-groups"];
    let group = GROUP.to_string();
    let member = ["--groups", &group];
    let can = rustix::process::geteuid().is_root()
        && as_user(&nobody, &["--version"]).output().is_ok_and(|output| output.status.success());
    if !can {
        skip(Need::Namespaces, "a second user needs root, setpriv, and a program that it can run");
        return;
    }
    // The second user can reach the socket, and what it may do there is up to mode and group.
    std::fs::set_permissions(bench.folder.path(), std::fs::Permissions::from_mode(0o755))
        .expect("own folder");
    let socket = bench.path("socket").display().to_string();
    for (mode, of_nobody, of_member) in [("0600", false, false), ("0660", false, true), ("0666", true, true)]
    {
        bench.configure(&format!(
            "[source]\nkind = \"scene\"\n[stream]\nsocket = \"{socket}\"\nmode = \"{mode}\"\ngroup = \"{GROUP}\"\n"
        ));
        let daemon = bench.start(&["run"]);
        let server = bench.start(&["stream", "--serve"]);
        drop(connect(&socket));
        let metadata = std::fs::symlink_metadata(&socket).expect("a socket");
        assert_eq!((format!("0{:o}", metadata.mode() & 0o777), metadata.gid()), (mode.into(), GROUP));
        for (groups, may) in [(&nobody[..], of_nobody), (&member[..], of_member)] {
            let args = ["stream", "--socket", &socket, "--limit", "1", "--topics", "alarm"];
            let output = as_user(groups, &args).output().expect("it runs");
            let errors = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.success(), may, "{mode} {groups:?}: {errors}");
            if may {
                let line: Value = serde_json::from_slice(&output.stdout).expect("a line");
                assert!(line["alarm"]["level"].is_string(), "{line}");
            } else {
                assert!(errors.contains("become a member of the group of the socket"), "{errors}");
            }
        }
        // A member can neither open the shared memory nor replace the socket.
        let script = format!(
            "for f in /dev/shm/lookout.*; do cat $f >/dev/null 2>&1 && exit 1; done; ! rm -f {socket} 2>/dev/null"
        );
        let mut attack = Command::new("setpriv");
        attack.args(["--reuid", "65534", "--regid", "65534"]).args(member).args(["sh", "-c", &script]);
        assert!(attack.status().expect("setpriv runs").success());
        let begin = Instant::now();
        bench.status_when(|status| status["state"] == "running" || begin.elapsed() > WATCHDOG);
        for process in [server, daemon] {
            process.signal("TERM");
            assert!(process.wait().status.success());
        }
    }
    bench.assert_clean();
}
