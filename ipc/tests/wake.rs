//! Every message wakes its reader, for any interleaving of sending and draining.

use lookout_ipc::bus::{Bus, IpcError};
use lookout_ipc::header::{Header, Kind};
use lookout_ipc::instance::{Instance, InstanceLock};
use lookout_ipc::service::COMMAND;
use lookout_ipc::wait::{self, Next};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const MESSAGES: u64 = 50_000;

/// A reader that sleeps this long although a message is there was not woken.
const LONG: Duration = Duration::from_secs(10);

#[test]
fn no_wake_up_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new("wake", folder.path());
    let _lock = InstanceLock::take(&instance).unwrap();
    let bus = Bus::join(&instance).unwrap();
    let subscriber = bus.subscriber(&COMMAND).unwrap();
    // Number of received messages. The next one is sent as soon as it grows, while the reader still drains the
    // notification of the last one.
    let taken = AtomicU64::new(0);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let bus = Bus::join(&instance).unwrap();
            let publisher = bus.publisher(&COMMAND, 0, 0).unwrap();
            let mut random = fastrand::Rng::with_seed(3);
            for sequence in 0..MESSAGES {
                while taken.load(Ordering::Acquire) < sequence {
                    std::thread::yield_now();
                }
                for _ in 0..random.u32(..200) {
                    std::hint::spin_loop();
                }
                let mut loan = publisher.loan(8).unwrap();
                *loan.header_mut() = Header::new(Kind::Command);
                loan.header_mut().sequence = sequence;
                publisher.send(loan).unwrap();
            }
            while taken.load(Ordering::Acquire) < MESSAGES {
                std::thread::yield_now();
            }
        });
        let mut asleep_since = Instant::now();
        let result = wait::run::<IpcError>(&[&subscriber], || {
            let slept = asleep_since.elapsed();
            while let Some(sample) = subscriber.receive()? {
                let sequence = sample.header().sequence;
                if slept >= LONG {
                    // Ends the other thread before this one panics.
                    taken.store(MESSAGES, Ordering::Release);
                    panic!("message {sequence} did not wake its reader");
                }
                taken.store(sequence + 1, Ordering::Release);
            }
            asleep_since = Instant::now();
            let over = taken.load(Ordering::Acquire) >= MESSAGES;
            Ok(if over { Next::Stop } else { Next::Wait(LONG) })
        });
        result.unwrap();
    });
}
