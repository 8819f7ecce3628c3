//! The daemon's status as a file of the runtime directory. `pairmaskd status` reads it without
//! taking a client's slot, and recognises a daemon that hangs.
//!
//! The file is replaced as a whole, never mapped. A reader copies it once and checks the copy, as
//! with any input from outside.

use std::path::PathBuf;
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use pairmask_wire::{InstanceError, InstanceName, SkipTotals, StatusBody};
use rustix::time::{ClockId, clock_gettime};

use crate::instance::RuntimeDir;
use crate::trust::{read_own, replace_own};

/// "PMAC" in memory order.
const MAGIC: u32 = u32::from_le_bytes(*b"PMAC");

/// Contents of a status file: the daemon's status, and when it was written. Two of a daemon differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct StatusFile {
    magic: u32,
    /// Length of this struct, bytes; a later version may be longer.
    bytes: u32,
    noted_at_ns: u64,
    /// The daemon's status.
    pub body: StatusBody,
    /// Work that its answers left out; zero where an earlier version wrote the file.
    pub skips: SkipTotals,
    /// Its GPUs; as `skips`.
    pub gpus: GpuCounts,
}

/// The GPUs of a daemon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct GpuCounts {
    /// Those that are being opened: cores serve meanwhile.
    pub opening: u32,
    /// Those that serve.
    pub open: u32,
}

/// Length of the file before it had [`SkipTotals`], bytes.
const FIRST_BYTES: usize = 16 + size_of::<StatusBody>();

const _: () = assert!(
    size_of::<StatusFile>() == FIRST_BYTES + size_of::<SkipTotals>() + size_of::<GpuCounts>()
);

/// The system's monotonic clock, ns. Time namespaces shift it: a reader compares no time of its own.
fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec.unsigned_abs() as u32).as_nanos() as u64
}

impl StatusFile {
    /// A status file with the time of now.
    pub fn now(body: StatusBody, skips: SkipTotals, gpus: GpuCounts) -> Self {
        let bytes = size_of::<Self>() as u32;
        Self { magic: MAGIC, bytes, noted_at_ns: now_ns(), body, skips, gpus }
    }

    /// Reads the bytes of a file, which a later version may have written; `None` where they are none of a status file.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let says: [u32; 2] = bytemuck::pod_read_unaligned(bytes.get(..8)?);
        let len = (says[1] as usize).min(size_of::<Self>());
        if says[0] != MAGIC || len < FIRST_BYTES {
            return None;
        }
        let mut whole = [0; size_of::<Self>()];
        whole[..len].copy_from_slice(bytes.get(..len)?);
        Some(bytemuck::pod_read_unaligned(&whole))
    }
}

impl RuntimeDir {
    pub(super) fn status_file(&self, name: &InstanceName) -> PathBuf {
        self.file(name, ".account")
    }

    /// Replaces the status file of an instance in one step.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn write_status(
        &self,
        name: &InstanceName,
        status: &StatusFile,
    ) -> Result<(), InstanceError> {
        let new = self.file(name, ".account.new");
        let shared = self.group().is_some();
        replace_own(&new, &self.status_file(name), bytemuck::bytes_of(status), shared)
    }

    /// The status file of an instance, or `None` where there is none or it is malformed.
    ///
    /// # Errors
    /// [`InstanceError`] where the file is not this user's alone.
    pub fn read_status(&self, name: &InstanceName) -> Result<Option<StatusFile>, InstanceError> {
        let bytes = read_own(&self.status_file(name), size_of::<StatusFile>() as u64)?;
        Ok(bytes.as_deref().and_then(StatusFile::parse))
    }

    /// How long ago the status file was written, by the file system's clock, which namespaces share; zero
    /// where that is not known.
    pub fn status_age(&self, name: &InstanceName) -> Duration {
        let data = std::fs::symlink_metadata(self.status_file(name));
        let written_at = data.and_then(|data| data.modified()).ok();
        written_at.and_then(|at| at.elapsed().ok()).unwrap_or_default()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_status_file_round_trips_and_junk_is_none() {
        let skips = SkipTotals { words: 9, ..SkipTotals::default() };
        let gpus = GpuCounts { opening: 1, open: 2 };
        let body = StatusBody { frames: 7, ..StatusBody::default() };
        let status = StatusFile::now(body, skips, gpus);
        let bytes = bytemuck::bytes_of(&status);
        assert_eq!(StatusFile::parse(bytes), Some(status));
        assert_eq!(
            StatusFile::parse(&[bytes, &[1; 64]].concat()),
            Some(status),
            "a later, longer one"
        );
        assert_eq!(StatusFile::parse(&bytes[1..]), None);
        assert_eq!(StatusFile::parse(&bytes[..bytes.len() - 1]), None);
        assert_eq!(StatusFile::parse(&[]), None);
        assert_eq!(StatusFile::parse(&vec![0; bytes.len()]), None);
        let mut earlier = bytes[..FIRST_BYTES].to_vec();
        assert_eq!(StatusFile::parse(&earlier), None, "cut short");
        earlier[4..8].copy_from_slice(&(FIRST_BYTES as u32).to_le_bytes());
        let parsed = StatusFile::parse(&earlier).unwrap();
        assert_eq!((parsed.body.frames, parsed.skips), (7, SkipTotals::default()));
        let parsed = StatusFile::parse(&[&earlier[..], &[1; 64]].concat()).unwrap();
        assert_eq!(parsed.skips, SkipTotals::default(), "what follows is not the file's");
    }
}
