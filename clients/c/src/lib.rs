//! The C interface of `lookout-client`: an opaque handle, plain structures, errors as text. `include/lookout.h` is generated
//! from this source (`cargo run -p lookout-client-c --example generate`).
//!
//! This is an edge, as `ipc` is: pointers come from C, so its functions are unsafe. Everything behind them is safe code. A
//! panic ends no program: the call fails.

mod frame;

use client::{Client, LAYOUT, Options, alarm};
pub use frame::{LookoutFrame, LookoutOptions};
use std::ffi::{CStr, CString, c_char, c_int};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::null;
use std::time::Duration;

/// A client. Calls with the same client must not overlap.
#[derive(Debug)]
pub struct LookoutClient {
    client: Client,
    /// Why the last call gave no frame.
    error: CString,
    run: CString,
    reason: CString,
}

const PANICKED: &str = "the library has failed: please report what was read";

/// Text for C: up to the first zero.
fn c_string(text: &str) -> CString {
    let end = text.find('\0').unwrap_or(text.len());
    CString::new(&text[..end]).unwrap_or_default()
}

/// The text of a pointer; `None` for NULL.
///
/// # Safety
/// It is NULL or leads to a terminated text that nobody writes meanwhile.
unsafe fn text<'a>(pointer: *const c_char, what: &str) -> Result<Option<&'a str>, String> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: the caller's promise.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map(Some).map_err(|_| format!("{what} is no UTF-8"))
}

/// # Safety
/// As `lookout_open`.
unsafe fn open(options: *const LookoutOptions) -> Result<Box<LookoutClient>, String> {
    // SAFETY: the caller's promise.
    let options = unsafe { options.as_ref() }.ok_or("the options are NULL")?;
    if options.layout != u32::from(LAYOUT) {
        return Err(format!(
            "the program was compiled with layout {}, the library has {LAYOUT}: compile it with the header of this library",
            options.layout
        ));
    }
    // SAFETY: the caller's promise.
    let (instance, directory) =
        unsafe { (text(options.instance, "instance")?, text(options.directory, "directory")?) };
    let default = Options::default();
    let client = Client::open(Options {
        instance: instance.map_or(default.instance, Into::into),
        directory: directory.map_or(default.directory, Into::into),
        pictures: options.pictures != 0,
    });
    let client = client.map_err(|error| error.to_string())?;
    let [error, run, reason] = [const { String::new() }; 3].map(|text| c_string(&text));
    Ok(Box::new(LookoutClient { client, error, run, reason }))
}

/// Opens a client of a daemon, which need not run yet. Returns NULL if the options are wrong; `error`, if it is not NULL, then
/// gets the reason, cut to `error_bytes` with its terminating zero.
///
/// # Safety
/// `options` and its texts are valid during the call, `error` is NULL or has `error_bytes` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lookout_open(
    options: *const LookoutOptions,
    error: *mut c_char,
    error_bytes: usize,
) -> *mut LookoutClient {
    // SAFETY: the caller's promise.
    let opened = catch_unwind(|| unsafe { open(options) });
    let reason = match opened.unwrap_or_else(|_| Err(PANICKED.into())) {
        Ok(client) => return Box::into_raw(client),
        Err(reason) => reason,
    };
    if !error.is_null() && error_bytes > 0 {
        let mut end = reason.len().min(error_bytes - 1);
        while !reason.is_char_boundary(end) {
            end -= 1;
        }
        // SAFETY: `end` is less than `error_bytes`, which the caller promises.
        unsafe {
            error.cast::<u8>().copy_from_nonoverlapping(reason.as_ptr(), end);
            error.add(end).write(0);
        }
    }
    std::ptr::null_mut()
}

/// Gets the newest frame that was not given before; waits for it at most `timeout_ms` milliseconds. Returns 1 with a frame, 0
/// if none came, -1 if there is a daemon that could not be read; `lookout_error` then says why. A later call tries again, and
/// goes on with the next run when the daemon was restarted.
///
/// # Safety
/// `client` is open, and no other call with it runs; `frame` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lookout_next(
    client: *mut LookoutClient,
    timeout_ms: u32,
    frame: *mut LookoutFrame,
) -> c_int {
    // SAFETY: the caller's promise.
    let Some(client) = (unsafe { client.as_mut() }) else { return -1 };
    if frame.is_null() {
        client.error = c_string("the frame is NULL");
        return -1;
    }
    let timeout = Duration::from_millis(timeout_ms.into());
    let advanced =
        catch_unwind(AssertUnwindSafe(|| client.client.advance(timeout).map_err(|e| e.to_string())));
    match advanced.unwrap_or_else(|_| Err(PANICKED.into())) {
        Ok(true) => {
            let Some(found) = client.describe() else { return 0 };
            // SAFETY: the caller's promise.
            unsafe { frame.write(found) };
            1
        }
        Ok(false) => {
            client.error = c_string(client.client.waits());
            0
        }
        Err(error) => {
            client.error = c_string(&error);
            -1
        }
    }
}

impl LookoutClient {
    /// The frame that was found last, for C.
    fn describe(&mut self) -> Option<LookoutFrame> {
        let frame = self.client.frame()?;
        self.error = CString::default();
        self.run = c_string(frame.run);
        self.reason = c_string(&frame.reason());
        let pictures = frame.pictures;
        Some(LookoutFrame {
            sequence: frame.sequence,
            source_ns: frame.source_ns,
            capture_ns: frame.capture_ns,
            result_ns: frame.result_ns,
            run: self.run.as_ptr(),
            reason: self.reason.as_ptr(),
            alarm: frame.alarm,
            obstacles: frame.obstacles.as_ptr(),
            motion: frame.motion,
            vehicle: frame.vehicle,
            rig: frame.rig,
            disparity: pictures.map_or(null(), |pictures| pictures.disparity.as_ptr()),
            confidence: pictures.map_or(null(), |pictures| pictures.confidence.as_ptr()),
            left: pictures.map_or(null(), |pictures| pictures.left.as_ptr()),
            right: pictures.map_or(null(), |pictures| pictures.right.as_ptr()),
            obstacle_count: frame.obstacles.len() as u32,
            withdrawn: frame.withdrawn.into(),
            width: frame.width,
            height: frame.height,
            modes: frame.modes,
            reserved: 0,
        })
    }
}

/// Why the last call of `lookout_next` gave no frame; empty if it gave one. Valid until the next call with the same client.
///
/// # Safety
/// `client` is open, and no other call with it runs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lookout_error(client: *const LookoutClient) -> *const c_char {
    // SAFETY: the caller's promise.
    match unsafe { client.as_ref() } {
        Some(client) => client.error.as_ptr(),
        None => c"the client is NULL".as_ptr(),
    }
}

/// Closes a client; NULL is allowed. The pointers of its last frame are no longer valid.
///
/// # Safety
/// `client` is NULL or open, and no other call with it runs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lookout_close(client: *mut LookoutClient) {
    if !client.is_null() {
        // SAFETY: it comes from `lookout_open`, and the caller promises that it was not closed.
        let client = unsafe { Box::from_raw(client) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(client)));
    }
}

/// The layout of the structures that the library was built with, to compare with `LOOKOUT_LAYOUT`.
#[unsafe(no_mangle)]
pub extern "C" fn lookout_layout() -> u32 {
    LAYOUT.into()
}

/// Name of a level of the alarm: `off`, `clear`, `warning`, `alarm`. An unknown one counts as `off`.
#[unsafe(no_mangle)]
pub extern "C" fn lookout_level_name(level: u32) -> *const c_char {
    const NAMES: [&CStr; alarm::LEVELS.len()] = [c"off", c"clear", c"warning", c"alarm"];
    NAMES.get(level as usize).unwrap_or(&NAMES[0]).as_ptr()
}
