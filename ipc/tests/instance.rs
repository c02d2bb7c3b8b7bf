//! The lock of an instance, and which files it removes.

use lookout_ipc::instance::{Instance, InstanceError, InstanceLock};
use std::path::{Path, PathBuf};

#[test]
fn an_instance_is_held_once_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("run");
    let instance = Instance::new("lock-test", &base);
    assert!(!instance.is_running() && instance.prefix().is_none());
    let lock = InstanceLock::take(&instance, 1).unwrap();
    assert!(instance.is_running() && instance.owner().is_some());
    assert_eq!(instance.prefix().as_deref(), Some(lock.prefix()));
    assert_eq!(instance.shared_memory().len(), 1, "the marker of the run");
    let error = InstanceLock::take(&instance, 2).unwrap_err().to_string();
    assert!(error.contains("already running") && error.contains(&std::process::id().to_string()), "{error}");
    lock.check_memory(1).unwrap();
    assert!(lock.check_memory(u64::MAX).unwrap_err().to_string().contains("/dev/shm"));
    let prefix = lock.prefix().to_owned();
    drop(lock);
    assert!(!instance.is_running() && !base.exists());
    assert!(!Path::new("/dev/shm").join(format!("{prefix}run")).exists());
    // A base folder that existed before is kept.
    drop(InstanceLock::take(&Instance::new("lock-test", folder.path()), 3).unwrap());
    assert!(folder.path().exists());
}

#[test]
fn remains_of_a_dead_run_are_removed_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    // A live run with another name and folder, and a dead one, whose marker is not locked.
    let living = InstanceLock::take(&Instance::new("living", folder.path()), 10).unwrap();
    let shm = |name: String| PathBuf::from("/dev/shm").join(name);
    let (kept, dead) = (shm(format!("{}data", living.prefix())), "lookout.1.beef.");
    let (gone, mark) = (shm(format!("{dead}data")), shm(format!("{dead}run")));
    let foreign = shm(format!("lookout-foreign-{}", std::process::id()));
    for path in [&kept, &gone, &mark, &foreign] {
        std::fs::write(path, b"x").unwrap();
    }
    let instance = Instance::new("taker", folder.path());
    std::fs::create_dir_all(instance.bus_directory().join("services/old")).unwrap();
    std::fs::write(instance.directory().join("mine.txt"), b"a user's file").unwrap();
    let lock = InstanceLock::take(&instance, 11).unwrap();
    assert!(lock.stale >= 3, "{}", lock.stale);
    assert!(!gone.exists() && !mark.exists() && kept.exists() && foreign.exists());
    drop(lock);
    assert!(instance.directory().join("mine.txt").exists(), "files of the user are kept");
    std::fs::remove_file(foreign).unwrap();
    drop(living);
    assert!(!kept.exists());
}

#[test]
fn unusable_folders_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let long = Instance::new("x", &folder.path().join("a".repeat(80)));
    assert!(matches!(InstanceLock::take(&long, 1), Err(InstanceError::TooLong { .. })));
    std::os::unix::fs::symlink("/tmp", folder.path().join("link")).unwrap();
    let linked = Instance::new("link", folder.path());
    assert!(matches!(InstanceLock::take(&linked, 1), Err(InstanceError::Foreign { .. })));
    std::fs::write(folder.path().join("file"), b"x").unwrap();
    let file = Instance::new("x", &folder.path().join("file"));
    let error = InstanceLock::take(&file, 1).unwrap_err().to_string();
    assert!(error.contains("instance.directory"), "{error}");
}

#[test]
fn a_folder_that_others_can_write_or_a_link_is_not_used() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new("own", folder.path());
    instance.check_owner().unwrap();
    std::fs::create_dir(instance.directory()).unwrap();
    instance.check_owner().unwrap();
    for (mode, is_safe) in [(0o777, false), (0o770, false), (0o755, true), (0o700, true)] {
        std::fs::set_permissions(instance.directory(), PermissionsExt::from_mode(mode)).unwrap();
        assert_eq!(instance.check_owner().is_ok(), is_safe, "{mode:o}");
        assert_eq!(instance.check_owner_or_root().is_ok(), is_safe, "{mode:o}");
    }
    std::os::unix::fs::symlink(instance.directory(), folder.path().join("link")).unwrap();
    let link = Instance::new("link", folder.path());
    assert!(matches!(link.check_owner(), Err(InstanceError::Foreign { .. })));
    assert!(lookout_ipc::bus::Bus::join(&link).is_err());
}
