//! The client libraries in the hands of another user, also of a member of the group of the daemon's folder.

use crate::support::{Bench, Need, skip};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::Path;
use std::process::{Command, Output};

/// A group that nobody is a member of.
const GROUP: u32 = 54_321;

/// What the library says, called as another user with ctypes, which is in every Python.
const PROGRAM: &str = r#"
import ctypes, sys
library = ctypes.CDLL(sys.argv[1])
library.lookout_error.restype = ctypes.c_char_p
library.lookout_open.restype = ctypes.c_void_p
class Options(ctypes.Structure):
    _fields_ = [("layout", ctypes.c_uint32), ("pictures", ctypes.c_uint32), ("instance", ctypes.c_char_p), ("directory", ctypes.c_char_p)]
options = Options(library.lookout_layout(), 1, sys.argv[2].encode(), sys.argv[3].encode())
client = ctypes.c_void_p(library.lookout_open(ctypes.byref(options), None, 0))
print(library.lookout_next(client, 1000, ctypes.create_string_buffer(4096)), library.lookout_error(client).decode())
"#;

#[test]
fn another_user_gets_no_frame_but_the_remedy_also_as_a_member_of_the_group() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\n");
    let library = bench.path("liblookout.so");
    let built = std::env::current_exe().expect("a path").with_file_name("liblookout.so");
    std::fs::copy(built, &library).expect("cargo has built it beside this program");
    std::fs::write(bench.path("read.py"), PROGRAM).expect("own folder");
    for (path, mode) in [(bench.folder.path(), 0o755), (&library, 0o755), (&bench.path("read.py"), 0o644)] {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("own folder");
    }
    let group = GROUP.to_string();
    let read = |user: &[&str]| -> Output {
        let mut command = Command::new("setpriv");
        command.args(user).arg("/usr/bin/python3").arg(bench.path("read.py")).arg(&library);
        command.arg(&bench.instance).arg(bench.path("run")).current_dir("/").output().expect("setpriv runs")
    };
    let nobody = ["--reuid", "65534", "--regid", "65534", "--clear-groups"];
    let member = ["--reuid", "65534", "--regid", "65534", "--groups", &group];
    let text = |output: Output| String::from_utf8_lossy(&output.stdout).into_owned();
    if !rustix::process::geteuid().is_root() || !text(read(&nobody)).starts_with("0 ") {
        skip(Need::Namespaces, "a second user needs root, setpriv, and the system's python3");
        return;
    }
    let daemon = bench.start(&["run"]);
    bench.status_when(|status| status["state"] == "running");
    let own = text(read(&["--reuid", "0"]));
    assert_eq!(own.trim(), "1", "the daemon's user gets a frame");
    // The folders let their group look inside; what lies there is the daemon's user's alone.
    for folder in [bench.path("run"), bench.path("run").join(&bench.instance)] {
        chown(&folder, None, Some(GROUP)).expect("root may");
        assert_eq!(std::fs::metadata(&folder).expect("it is there").mode() & 0o777, 0o750);
    }
    let refused = text(read(&nobody));
    assert!(refused.starts_with("0 no daemon named") && refused.contains("lookout stream"), "{refused}");
    let refused = text(read(&member));
    assert!(refused.starts_with("-1 the daemon") && refused.contains("only its own user can"), "{refused}");
    assert!(refused.contains("lookout stream"), "{refused}");
    // Not by the library's courtesy alone: no file of the run can be opened.
    let opened = |file: &Path| {
        let mut command = Command::new("setpriv");
        command.args(member).args(["test", "-r"]).arg(file).arg("-o").arg("-w").arg(file);
        command.status().expect("setpriv runs").success()
    };
    let prefix =
        std::fs::read_to_string(bench.path("run").join(&bench.instance).join("lock")).expect("own file");
    let prefix = prefix.lines().nth(1).expect("the run").to_owned();
    let mut files = 0;
    for entry in std::fs::read_dir("/dev/shm").expect("it is there").flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            assert!(!opened(&entry.path()), "{:?}", entry.path());
            files += 1;
        }
    }
    assert!(files > 10, "{files} files of the run");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}
