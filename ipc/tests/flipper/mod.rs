//! Another process of this user, which writes shared memory while a message in it is read.

use std::fs::{File, OpenOptions};
use std::io::Read;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Bytes of shared memory that are overwritten: file, first byte, what they hold.
pub struct Place {
    file: File,
    at: u64,
    content: Vec<u8>,
}

impl Place {
    /// Sets what the place holds between two writes of random bytes, and how many bytes are overwritten.
    #[allow(dead_code, reason = "not every test program uses it")]
    pub fn set_content(&mut self, content: &[u8]) {
        self.content = content.to_vec();
    }
}

/// The places in these files that hold `content`.
pub fn places(files: &[PathBuf], content: &[u8]) -> Vec<Place> {
    let mut places = Vec::new();
    for path in files {
        let mut bytes = Vec::new();
        let Ok(mut file) = OpenOptions::new().read(true).write(true).open(path) else { continue };
        if file.read_to_end(&mut bytes).is_err() {
            continue;
        }
        for at in (0..bytes.len()).step_by(8).filter(|&at| bytes[at..].starts_with(content)) {
            let file = file.try_clone().expect("a descriptor");
            places.push(Place { file, at: at as u64, content: content.to_vec() });
        }
    }
    places
}

/// Writes random bytes to places, and now and then what they held before, until it is dropped.
pub struct Flipper {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Flipper {
    /// Starts to write. Every write changes up to `most` neighbouring bytes.
    pub fn start(places: Vec<Place>, most: usize) -> Self {
        assert!(!places.is_empty(), "the message is found in shared memory");
        let stop = Arc::new(AtomicBool::new(false));
        let thread = std::thread::spawn({
            let stop = Arc::clone(&stop);
            move || {
                let mut random = fastrand::Rng::with_seed(17);
                while !stop.load(Ordering::Relaxed) {
                    for place in &places {
                        for _ in 0..random.usize(1..4) {
                            let at = random.usize(0..place.content.len());
                            let length = random.usize(1..=most).min(place.content.len() - at);
                            let bytes: Vec<u8> =
                                std::iter::repeat_with(|| random.u8(..)).take(length).collect();
                            place.file.write_all_at(&bytes, place.at + at as u64).expect("it is written");
                        }
                        for _ in 0..random.usize(0..500) {
                            std::hint::spin_loop();
                        }
                        // A reader that shares this core sees the change only while this thread sleeps.
                        if random.u8(0..4) == 0 {
                            std::thread::sleep(Duration::from_micros(random.u64(0..100)));
                        }
                        place.file.write_all_at(&place.content, place.at).expect("it is written");
                        // So that messages are accepted and then change.
                        std::thread::sleep(Duration::from_micros(random.u64(0..300)));
                    }
                }
            }
        });
        Self { stop, thread: Some(thread) }
    }
}

impl Drop for Flipper {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
