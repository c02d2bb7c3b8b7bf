//! The lock of an instance, and which files it removes.

use lookout_ipc::bus::Bus;
use lookout_ipc::instance::{Instance, InstanceError, InstanceLock};
use lookout_ipc::service::COMMAND;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

#[test]
fn an_instance_is_held_once_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("run");
    let instance = Instance::new("lock-test", &base);
    assert!(!instance.is_running() && instance.prefix().is_none());
    let lock = InstanceLock::take(&instance).unwrap();
    assert!(instance.is_running() && instance.owner().is_some());
    assert_eq!(instance.prefix().as_ref(), Some(lock.prefix()));
    assert_eq!(instance.shared_memory().len(), 2, "the mark of the run and the node counter");
    let error = InstanceLock::take(&instance).unwrap_err().to_string();
    assert!(error.contains("already running") && error.contains(&std::process::id().to_string()), "{error}");
    lock.check_memory(1).unwrap();
    assert!(lock.check_memory(u64::MAX).unwrap_err().to_string().contains("/dev/shm"));
    let prefix = lock.prefix().clone();
    drop(lock);
    assert!(!instance.is_running() && !base.exists());
    assert!(!Path::new("/dev/shm").join(format!("{}run", prefix.as_str())).exists());
    // A base folder that existed before is kept.
    drop(InstanceLock::take(&Instance::new("lock-test", folder.path())).unwrap());
    assert!(folder.path().exists());
}

#[test]
fn remains_of_a_dead_run_are_removed_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    // A live run with another name and folder, and a dead one, whose marker is not locked.
    let living = InstanceLock::take(&Instance::new("living", folder.path())).unwrap();
    let shm = |name: String| PathBuf::from("/dev/shm").join(name);
    let (kept, dead) = (shm(format!("{}data", living.prefix().as_str())), "lookout.aaaaaaaaaaaa.");
    let (gone, mark) = (shm(format!("{dead}data")), shm(format!("{dead}run")));
    let foreign = shm(format!("lookout-foreign-{}", std::process::id()));
    // The name of a mark without a prefix of the right form: it would stand for the files of all runs.
    let trap = shm("lookout.run".into());
    for path in [&kept, &gone, &mark, &foreign, &trap] {
        std::fs::write(path, b"x").unwrap();
    }
    let instance = Instance::new("taker", folder.path());
    std::fs::create_dir_all(instance.bus_directory().join("services/old")).unwrap();
    std::fs::write(instance.directory().join("mine.txt"), b"a user's file").unwrap();
    let lock = InstanceLock::take(&instance).unwrap();
    assert!(lock.stale >= 3, "{}", lock.stale);
    assert!(!gone.exists() && !mark.exists() && kept.exists() && foreign.exists() && trap.exists());
    drop(lock);
    assert!(instance.directory().join("mine.txt").exists(), "files of the user are kept");
    std::fs::remove_file(foreign).unwrap();
    std::fs::remove_file(trap).unwrap();
    drop(living);
    assert!(!kept.exists());
}

#[test]
fn unusable_folders_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let long = Instance::new("x", &folder.path().join("a".repeat(80)));
    assert!(matches!(InstanceLock::take(&long), Err(InstanceError::TooLong { .. })));
    std::os::unix::fs::symlink("/tmp", folder.path().join("link")).unwrap();
    let linked = Instance::new("link", folder.path());
    assert!(matches!(InstanceLock::take(&linked), Err(InstanceError::Foreign { .. })));
    std::fs::write(folder.path().join("file"), b"x").unwrap();
    let file = Instance::new("x", &folder.path().join("file"));
    let error = InstanceLock::take(&file).unwrap_err().to_string();
    assert!(error.contains("instance.directory"), "{error}");
    // Another user could replace everything below a base folder that everybody may write.
    let open = folder.path().join("open");
    std::fs::create_dir(&open).unwrap();
    std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o777)).unwrap();
    let inside = Instance::new("x", &open);
    assert!(matches!(InstanceLock::take(&inside), Err(InstanceError::Foreign { .. })));
    assert!(!inside.directory().exists());
    std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o1777)).unwrap();
    drop(InstanceLock::take(&inside).unwrap());
}

#[test]
fn a_removed_file_of_the_run_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new("eroded", folder.path());
    let mut lock = InstanceLock::take(&instance).unwrap();
    std::fs::create_dir(instance.bus_directory()).unwrap();
    lock.record_files();
    assert_eq!(lock.missing_file(), None);
    // A file of a reader comes and goes.
    let passing = PathBuf::from("/dev/shm").join(format!("{}reader.connection", lock.prefix().as_str()));
    std::fs::write(&passing, b"x").unwrap();
    lock.record_files();
    std::fs::remove_file(&passing).unwrap();
    assert_eq!(lock.missing_file(), None);
    let bus = Bus::join(&instance).unwrap();
    let publisher = bus.publisher(&COMMAND, 0, 0).unwrap();
    lock.record_files();
    assert_eq!(lock.missing_file(), None);
    let is_lasting = |path: &PathBuf| {
        let name = path.to_string_lossy();
        name.ends_with(".data") || name.ends_with(".dynamic") || name.ends_with(".run")
    };
    let lasting: Vec<PathBuf> = instance.shared_memory().into_iter().filter(is_lasting).collect();
    assert!(lasting.len() >= 4, "pool, two services, mark: {lasting:?}");
    for path in lasting {
        std::fs::remove_file(&path).unwrap();
        assert_eq!(lock.missing_file(), Some(path.as_path()));
        lock.record_files();
        assert_eq!(lock.missing_file(), None);
    }
    // A process that joined now would leave files that nobody removes.
    let error = Bus::join(&instance).unwrap_err().to_string();
    assert!(error.contains("its run is ending"), "{error}");
    drop((publisher, bus));
    std::fs::remove_dir_all(instance.bus_directory()).unwrap();
    std::fs::create_dir(instance.bus_directory()).unwrap();
    lock.record_files();
    std::fs::remove_dir(instance.bus_directory()).unwrap();
    assert_eq!(lock.missing_file(), Some(instance.bus_directory().as_path()));
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
