//! Files of the service registry are not written through to the disk.
//!
//! iceoryx2 calls `fsync` for each file of its registry, which lies in the instance's folder, by default below /tmp. There
//! it waits for the disk: for seconds on an SD card, or beside a program that writes much, while a stage is not restarted
//! and readers wait to join. The registry is worth nothing after a reboot, so nothing is lost (see [`fsync`]).

use crate::stall;
use rustix::fd::BorrowedFd;
use rustix::io::Errno;
use std::ffi::c_int;

/// Replaces the function of the C library in this program: as fsync(2), but inside a call into iceoryx2 it does nothing.
///
/// iceoryx2 has no setting for it.
// SAFETY: the signature is that of POSIX, and so is the contract.
#[unsafe(no_mangle)]
pub extern "C" fn fsync(file: c_int) -> c_int {
    if stall::is_inside_call() {
        return 0;
    }
    if file < 0 {
        return crate::free_memory::fail(Errno::BADF);
    }
    // SAFETY: the caller owns the descriptor during this call; of a closed one the use below returns EBADF.
    let file = unsafe { BorrowedFd::borrow_raw(file) };
    // A system call of its own: it does not come back to this function.
    match rustix::fs::fsync(file) {
        Ok(()) => 0,
        Err(error) => crate::free_memory::fail(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stall::{Call, Guard};
    use std::io::Error;

    unsafe extern "C" {
        /// As iceoryx2 and the standard library find it.
        #[link_name = "fsync"]
        safe fn linked(file: c_int) -> c_int;
    }

    #[test]
    fn only_calls_into_iceoryx2_do_not_wait_for_the_disk() {
        // No file has this descriptor.
        let closed = c_int::MAX;
        {
            let _guard = Guard::enter(Call::Join);
            assert_eq!(linked(closed), 0);
        }
        assert_eq!(linked(closed), -1);
        assert_eq!(Error::last_os_error().raw_os_error(), Some(Errno::BADF.raw_os_error()));
        let file = tempfile::tempfile().unwrap();
        file.sync_all().unwrap();
    }
}
