//! Shared memory that is really there before anybody writes to it.

use std::mem::MaybeUninit;

use crate::header::WireBlock;
use crate::service::{BlockLoan, BlockLoanUninit};

/// Why memory could not be had.
#[derive(Debug, thiserror::Error)]
pub enum MemoryError {
    #[error(
        "shared memory is full: {bytes} bytes cannot be had ({cause}); free some of /dev/shm, enlarge it, or load fewer or smaller scenes"
    )]
    Full {
        bytes: usize,
        #[source]
        cause: rustix::io::Errno,
    },
    #[error("{path:?}: {cause}; a field's segments need files in /dev/shm")]
    Segment {
        path: std::path::PathBuf,
        #[source]
        cause: std::io::Error,
    },
}

/// Memory that must stay free for what iceoryx2 writes by itself, bytes.
const MARGIN_BYTES: u64 = 1 << 20;

/// Checks that /dev/shm has room for `bytes` and a little more, before ports or tables are made. It may be gone a moment later;
/// [`provide`] is what makes sure.
pub fn check_room(bytes: usize) -> Result<(), MemoryError> {
    check_free(bytes, MARGIN_BYTES)
}

/// As [`check_room`], for a message of ports that are there already: iceoryx2 needs nothing beside it.
pub fn check_message_room(bytes: usize) -> Result<(), MemoryError> {
    check_free(bytes, 0)
}

fn check_free(bytes: usize, margin_bytes: u64) -> Result<(), MemoryError> {
    let Ok(state) = rustix::fs::statvfs("/dev/shm") else { return Ok(()) };
    let free = state.f_bavail.saturating_mul(state.f_frsize);
    if free >= (bytes as u64).saturating_add(margin_bytes) {
        return Ok(());
    }
    Err(MemoryError::Full { bytes, cause: rustix::io::Errno::NOSPC })
}

/// Memory that was lent by a publisher, all of it there to be written. It holds what was sent from there before, or zeroes: who writes into it leaves
/// nothing out.
pub fn provide(mut lent: BlockLoanUninit) -> Result<BlockLoan, MemoryError> {
    populate(lent.payload_mut())?;
    // SAFETY: a mapping of shared memory always holds bytes, whoever wrote them or nobody, and every byte pattern is a block.
    Ok(unsafe { lent.assume_init() })
}

/// Makes the kernel provide every page under `blocks` now. A sparse shared-memory file gets its pages on the first write, and when
/// /dev/shm is full that write kills the process; here the same fault is an error.
fn populate(blocks: &mut [MaybeUninit<WireBlock>]) -> Result<(), MemoryError> {
    // SAFETY: the same memory, byte by byte.
    populate_bytes(unsafe { std::slice::from_raw_parts_mut(blocks.as_mut_ptr().cast(), std::mem::size_of_val(blocks)) })
}

/// As [`populate`], for any writable memory.
pub(crate) fn populate_bytes(memory: &mut [MaybeUninit<u8>]) -> Result<(), MemoryError> {
    let page = rustix::param::page_size();
    let start = memory.as_mut_ptr() as usize & !(page - 1);
    let end = memory.as_mut_ptr_range().end as usize;
    if memory.is_empty() {
        return Ok(());
    }
    // SAFETY: the pages belong to a live writable mapping that holds the memory, and populating does not change their content.
    let done = unsafe { rustix::mm::madvise(start as *mut _, end - start, rustix::mm::Advice::LinuxPopulateWrite) };
    match done {
        // Linux before 5.14 does not know the advice: then a full /dev/shm cannot be told beforehand.
        Ok(()) | Err(rustix::io::Errno::INVAL) => Ok(()),
        Err(cause) => Err(MemoryError::Full { bytes: memory.len(), cause }),
    }
}

#[cfg(test)]
mod tests {
    use overfly_table::Block;

    use super::*;

    #[test]
    fn populated_memory_can_be_written_wherever_it_starts() {
        let mut blocks = vec![MaybeUninit::<WireBlock>::uninit(); 1000];
        populate(&mut blocks[3..]).unwrap();
        populate(&mut blocks[..0]).unwrap();
        for block in &mut blocks {
            block.write(WireBlock(Block::ZERO));
        }
    }

    #[test]
    fn pages_that_cannot_be_had_are_an_error() {
        // A file shorter than its mapping behaves as a full file system does: a write to the missing page would raise SIGBUS.
        let fd = rustix::fs::memfd_create("short", rustix::fs::MemfdFlags::CLOEXEC).unwrap();
        let (page, length) = (rustix::param::page_size(), 4 * rustix::param::page_size());
        rustix::fs::ftruncate(&fd, page as u64).unwrap();
        // SAFETY: a fresh mapping of our own.
        let memory = unsafe {
            let flags = (rustix::mm::ProtFlags::READ | rustix::mm::ProtFlags::WRITE, rustix::mm::MapFlags::SHARED);
            rustix::mm::mmap(std::ptr::null_mut(), length, flags.0, flags.1, &fd, 0).unwrap()
        };
        // SAFETY: uninitialised blocks inside of that mapping.
        let blocks = unsafe { std::slice::from_raw_parts_mut(memory.cast::<MaybeUninit<WireBlock>>(), length / 64) };
        let message = populate(blocks).unwrap_err().to_string();
        assert!(message.contains("/dev/shm"), "{message}");
        // SAFETY: the slice is not used any more.
        unsafe { rustix::mm::munmap(memory, length).unwrap() };
    }
}
