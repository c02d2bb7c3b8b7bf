//! The bus: the newest message replaces older ones, history, checks, waiting, cleaning up.

use lookout_ipc::bus::{Bus, IpcError};
use lookout_ipc::header::{Header, Kind, LINE_BYTES, MessageError};
use lookout_ipc::instance::{Instance, InstanceLock};
use lookout_ipc::port::Publisher;
use lookout_ipc::service::{COMMAND, OBSTACLES, PAIR, ServiceSpec};
use lookout_ipc::wait::{self, Next};
use lookout_ipc::{command, pair};
use std::os::unix::fs::PermissionsExt;
use std::time::Duration;

/// A separate instance for each test, and its temporary folder.
fn instance(name: &str) -> (tempfile::TempDir, Instance) {
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new(name, folder.path());
    (folder, instance)
}

fn header(sequence: u64, width: u32, height: u32) -> Header {
    let mut header = Header::new(Kind::Pair);
    (header.sequence, header.width, header.height) = (sequence, width, height);
    header
}

fn publish(publisher: &Publisher, sequence: u64) {
    let mut loan = publisher.loan(pair::payload_bytes(4, 2)).unwrap();
    *loan.header_mut() = header(sequence, 4, 2);
    loan.payload_mut().fill(sequence as u8);
    publisher.send(loan).unwrap();
}

#[test]
fn the_newest_message_replaces_older_ones_and_nothing_is_left_behind() {
    let (_folder, instance) = instance("newest");
    let lock = InstanceLock::take(&instance).unwrap();
    let bus = Bus::join(&instance).unwrap();
    let publisher = bus.publisher(&PAIR, 4, 2).unwrap();
    let subscriber = bus.subscriber(&PAIR).unwrap();
    assert!(subscriber.receive().unwrap().is_none());
    for sequence in 0..10 {
        publish(&publisher, sequence);
    }
    let sample = subscriber.receive().unwrap().unwrap();
    assert_eq!(sample.header().sequence, 9);
    // The subscriber existed before the first of them was sent.
    assert_eq!(subscriber.take_missed(), 9);
    let images = pair::view(sample.header(), sample.payload()).unwrap();
    assert_eq!((images.left, images.right), (&[9_u8; 8][..], &[9_u8; 8][..]));
    // A message that is being read does not change while newer ones are sent.
    for sequence in 10..20 {
        publish(&publisher, sequence);
    }
    assert_eq!(sample.payload()[0], 9);
    drop(sample);
    assert_eq!(subscriber.receive().unwrap().unwrap().header().sequence, 19);
    assert_eq!((subscriber.take_missed(), subscriber.take_missed()), (9, 0));
    // A later subscriber does not count messages that were sent before it existed.
    let late = bus.subscriber(&PAIR).unwrap();
    publish(&publisher, 20);
    assert_eq!(late.receive().unwrap().unwrap().header().sequence, 20);
    assert_eq!(late.take_missed(), 0);
    assert_eq!(subscriber.receive().unwrap().unwrap().header().sequence, 20);
    // A new publisher starts its serial numbers at 0, and subscribers follow.
    drop(publisher);
    let publisher = bus.publisher(&PAIR, 4, 2).unwrap();
    for sequence in 21..24 {
        publish(&publisher, sequence);
    }
    assert_eq!(subscriber.receive().unwrap().unwrap().header().sequence, 23);
    assert_eq!(subscriber.take_missed(), 2);
    // The pool has the size that the table gives.
    let pools = PAIR.pool_bytes(4, 2) as u64;
    assert!(instance.shared_bytes() < pools + 100_000, "{} for {pools}", instance.shared_bytes());
    assert!(subscriber.receive().unwrap().is_none());
    let files = instance.shared_memory();
    assert!(files.iter().any(|f| f.to_string_lossy().ends_with("_node.0_10_0.global_mgmt")), "{files:?}");
    for file in &files {
        // Also the node counter, which iceoryx2 would open to every user.
        let mode = std::fs::metadata(file).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600, "{}", file.display());
    }
    let prefix = lock.prefix().clone();
    drop((publisher, subscriber, late, bus, lock));
    let left = std::fs::read_dir("/dev/shm").unwrap().flatten();
    assert_eq!(left.filter(|e| e.file_name().to_string_lossy().starts_with(prefix.as_str())).count(), 0);
    assert!(!instance.directory().exists());
}

#[test]
fn nothing_is_missed_when_two_publishers_take_turns() {
    let (_folder, instance) = instance("turns");
    let _lock = InstanceLock::take(&instance).unwrap();
    let bus = Bus::join(&instance).unwrap();
    let subscriber = bus.subscriber(&OBSTACLES).unwrap();
    let senders = [(); 2].map(|()| bus.publisher(&OBSTACLES, 4, 2).unwrap());
    let send = |sender: usize| {
        let mut loan = senders[sender].loan(16).unwrap();
        *loan.header_mut() = Header::new(Kind::Obstacles);
        senders[sender].send(loan).unwrap();
        assert!(subscriber.receive().unwrap().is_some());
    };
    // One sends many messages, the other a few in between, as recognition and the scheduler do.
    for sender in [0, 0, 0, 0, 1, 0, 0, 1, 1, 0] {
        send(sender);
    }
    assert_eq!(subscriber.take_missed(), 0);
}

#[test]
fn late_readers_get_the_history_and_long_messages_are_refused() {
    let (_folder, instance) = instance("history");
    let _lock = InstanceLock::take(&instance).unwrap();
    let bus = Bus::join(&instance).unwrap();
    let publisher = bus.publisher(&COMMAND, 0, 0).unwrap();
    let record = command::CommandRecord { period_ns: 5, ..Default::default() };
    publisher.send_record(Header::new(Kind::Command), &record).unwrap();
    let late = bus.subscriber(&COMMAND).unwrap();
    publisher.refresh().unwrap();
    let sample = late.receive().unwrap().unwrap();
    assert_eq!(command::view(sample.header(), sample.payload()), Ok(record));
    assert!(publisher.loan(command::PAYLOAD_BYTES + LINE_BYTES).is_err());
}

#[test]
fn a_header_that_does_not_fit_its_payload_is_refused() {
    let (_folder, instance) = instance("lies");
    let _lock = InstanceLock::take(&instance).unwrap();
    let bus = Bus::join(&instance).unwrap();
    let publisher = bus.publisher(&PAIR, 4, 2).unwrap();
    let subscriber = bus.subscriber(&PAIR).unwrap();
    let mut loan = publisher.loan(16).unwrap();
    *loan.header_mut() = header(0, 8000, 8000);
    publisher.send(loan).unwrap();
    let sample = subscriber.receive().unwrap().unwrap();
    let error = pair::view(sample.header(), sample.payload()).unwrap_err();
    assert!(matches!(error, MessageError::Length { given: 16, .. }));
}

#[test]
fn waiting_ends_with_a_message_a_time_or_a_stop() {
    let (_folder, instance) = instance("wait");
    let _lock = InstanceLock::take(&instance).unwrap();
    let bus = Bus::join(&instance).unwrap();
    let publisher = bus.publisher(&PAIR, 4, 2).unwrap();
    let subscriber = bus.subscriber(&PAIR).unwrap();
    let (mut calls, mut seen) = (0, Vec::new());
    // A lost wake-up would make the test sleep for an hour: abort it instead.
    let (done, watched) = std::sync::mpsc::channel::<()>();
    std::thread::spawn(move || {
        if watched.recv_timeout(Duration::from_secs(60)) == Err(std::sync::mpsc::RecvTimeoutError::Timeout) {
            eprintln!("the wait never ended");
            std::process::abort();
        }
    });
    wait::run::<IpcError>(&[&subscriber], || {
        calls += 1;
        if let Some(sample) = subscriber.receive()? {
            seen.push(sample.header().sequence);
        }
        match calls {
            1 => publish(&publisher, 7),
            2 => return Ok(Next::Wait(Duration::from_millis(1))),
            3 => return Ok(Next::Stop),
            _ => unreachable!("Stop was ignored"),
        }
        Ok(Next::Wait(Duration::from_secs(3600)))
    })
    .unwrap();
    drop(done);
    assert_eq!((calls, seen), (3, vec![7]));
}

#[test]
fn a_service_with_other_settings_is_an_error() {
    let (_folder, instance) = instance("settings");
    let _lock = InstanceLock::take(&instance).unwrap();
    let bus = Bus::join(&instance).unwrap();
    let _first = bus.publisher(&OBSTACLES, 4, 2).unwrap();
    let other = ServiceSpec { buffer: 9, ..OBSTACLES };
    let error = bus.subscriber(&other).unwrap_err().to_string();
    assert!(error.contains("obstacles"), "{error}");
}
