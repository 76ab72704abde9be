//! Segments of fields in shared memory. Each is a file of its own that fields before and after an edit share; the field's table, which goes
//! the way of all messages, names those that belong to it.
//!
//! The daemon removes the file of a segment that no field of its has any more. Whoever has mapped it keeps its memory: the system counts the maps,
//! also of programs that were killed.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use overfly_table::{Block, TableMemory};
use rustix::mm::{MapFlags, MprotectFlags, ProtFlags, mmap, mprotect, munmap};

use crate::domain::Domain;
use crate::memory::{self, MemoryError};

/// What the names of these files end with.
pub const SUFFIX: &str = ".rows";

/// The number of the next segment of this process.
static NEXT: AtomicU64 = AtomicU64::new(1);

/// A segment that this process has written; its file goes with it.
#[derive(Debug)]
pub struct SegmentFile {
    path: PathBuf,
    number: u64,
    mapping: Mapping,
}

/// A segment of another process, mapped read-only.
#[derive(Debug)]
pub struct SegmentMap {
    mapping: Mapping,
}

impl SegmentFile {
    /// A segment of so many blocks, all zero and each of them backed by memory, for the daemon `instance`; `write` fills it. It never changes after that.
    pub fn create(domain: &Domain, instance: u64, count: usize, write: impl FnOnce(&mut [Block])) -> Result<Self, MemoryError> {
        memory::check_room(count * Block::BYTES)?;
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let path = path(domain, instance, number);
        let failed = |cause: io::Error| MemoryError::Segment { path: path.clone(), cause };
        let file = OpenOptions::new().read(true).write(true).create_new(true).mode(0o600).open(&path).map_err(failed)?;
        let segment = file.set_len((count * Block::BYTES) as u64).and_then(|()| Mapping::new(&file, count, Access::Write));
        let mut segment = match segment {
            Ok(mapping) => Self { path, number, mapping },
            Err(cause) => {
                let _ = fs::remove_file(&path);
                return Err(failed(cause));
            }
        };
        let start = segment.mapping.start.cast();
        // SAFETY: the mapping is as long, and nobody else has it.
        memory::populate_bytes(unsafe { std::slice::from_raw_parts_mut(start, count * Block::BYTES) })?;
        segment.mapping.write_once(write).map_err(|cause| MemoryError::Segment { path: segment.path.clone(), cause })?;
        Ok(segment)
    }
}

impl Drop for SegmentFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

impl TableMemory for SegmentFile {
    fn blocks(&self) -> &[Block] {
        self.mapping.blocks()
    }

    fn number(&self) -> u64 {
        self.number
    }
}

impl SegmentMap {
    /// Maps segment `number` of the daemon `instance`; there is none any more when the daemon has newer ones.
    pub fn open(domain: &Domain, instance: u64, number: u64) -> io::Result<Self> {
        let file = File::open(path(domain, instance, number))?;
        let bytes = usize::try_from(file.metadata()?.len()).map_err(io::Error::other)?;
        if bytes == 0 || bytes % Block::BYTES != 0 {
            return Err(io::ErrorKind::InvalidData.into());
        }
        Ok(Self { mapping: Mapping::new(&file, bytes / Block::BYTES, Access::Read)? })
    }
}

impl TableMemory for SegmentMap {
    fn blocks(&self) -> &[Block] {
        self.mapping.blocks()
    }
}

impl Domain {
    /// Removes the segments of daemons that serve the domain no more. Whoever reads them keeps them.
    pub(crate) fn remove_segments(&self) {
        let segments = self.shared_memory_files().into_iter();
        segments.filter(|path| path.as_os_str().as_encoded_bytes().ends_with(SUFFIX.as_bytes())).for_each(|path| {
            let _ = fs::remove_file(path);
        });
    }
}

fn path(domain: &Domain, instance: u64, number: u64) -> PathBuf {
    PathBuf::from(format!("/dev/shm/{}{instance:016x}_{number}{SUFFIX}", domain.prefix()))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Access {
    Read,
    Write,
}

/// Blocks of a file in memory.
#[derive(Debug)]
struct Mapping {
    start: *mut Block,
    count: usize,
}

// SAFETY: nobody writes to a mapping that is shared, and it may be unmapped on any thread.
unsafe impl Send for Mapping {}
// SAFETY: as above.
unsafe impl Sync for Mapping {}

impl Mapping {
    fn new(file: &File, count: usize, access: Access) -> io::Result<Self> {
        let protection = if access == Access::Write { ProtFlags::READ | ProtFlags::WRITE } else { ProtFlags::READ };
        // SAFETY: a fresh mapping at a place of the system's choice.
        let start = unsafe { mmap(std::ptr::null_mut(), count * Block::BYTES, protection, MapFlags::SHARED, file.as_fd(), 0)? };
        Ok(Self { start: start.cast(), count })
    }

    /// Lets a writable mapping be written, and never again.
    fn write_once(&mut self, write: impl FnOnce(&mut [Block])) -> io::Result<()> {
        // SAFETY: the mapping holds so many blocks, any bytes are blocks, and it is borrowed for as long.
        write(unsafe { std::slice::from_raw_parts_mut(self.start, self.count) });
        // SAFETY: the mapping is our own.
        unsafe { mprotect(self.start.cast(), self.count * Block::BYTES, MprotectFlags::READ)? };
        Ok(())
    }

    fn blocks(&self) -> &[Block] {
        // SAFETY: the mapping holds so many blocks for as long as `self` lives, and nobody writes to them any more.
        unsafe { std::slice::from_raw_parts(self.start, self.count) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: nobody borrows from it any more.
        let _ = unsafe { munmap(self.start.cast(), self.count * Block::BYTES) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_segment_is_shared_and_outlives_its_file() {
        let domain = Domain::new(&format!("seg-{}", std::process::id())).unwrap();
        let written = SegmentFile::create(&domain, 7, 100, |blocks| {
            assert!(blocks.iter().all(|block| *block == Block::ZERO));
            blocks[99] = Block([5; 8]);
        });
        let written = written.unwrap();
        let map = SegmentMap::open(&domain, 7, written.number()).unwrap();
        assert_eq!(map.blocks(), written.blocks());
        assert!(SegmentMap::open(&domain, 8, written.number()).is_err(), "another daemon's");
        let number = written.number();
        drop(written);
        assert_eq!(domain.shared_memory_files(), Vec::<PathBuf>::new());
        assert_eq!((map.blocks()[99], map.blocks().len()), (Block([5; 8]), 100));
        assert!(SegmentMap::open(&domain, 7, number).is_err());
    }

    #[test]
    fn what_a_killed_daemon_has_left_is_removed_while_its_readers_live() {
        let domain = Domain::new(&format!("sew-{}", std::process::id())).unwrap();
        let left = SegmentFile::create(&domain, 1, 1, |_| {}).unwrap();
        let map = SegmentMap::open(&domain, 1, left.number()).unwrap();
        std::mem::forget(left);
        assert_eq!(domain.shared_memory_files().len(), 1);
        let lock = domain.lock().unwrap();
        assert_eq!(domain.shared_memory_files(), Vec::<PathBuf>::new());
        assert_eq!(map.blocks(), [Block::ZERO]);
        lock.release();
    }
}
