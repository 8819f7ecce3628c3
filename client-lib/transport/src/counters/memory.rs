//! The memory of the counters: a file that is mapped, or where there is none memory that nobody else sees.
//!
//! Other processes of this user may write to the file, or cut it: the worker reads nothing of what it has written, and
//! gets zeros in the place of pages that are missing (`guard`).
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::ptr;
use std::sync::atomic::AtomicU64;

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

use crate::guard::Guarded;

#[derive(Debug)]
pub(super) enum Memory {
    Mapped(Mapped),
    Own(Box<[AtomicU64]>),
}

#[derive(Debug)]
pub(super) struct Mapped {
    // Before the mapping that it watches over: it is unmapped at the end of `drop`.
    guarded: Option<Guarded>,
    start: usize,
    words: usize,
}

impl Memory {
    /// The first words of a file, which is so long.
    pub fn map(file: &File, words: usize) -> io::Result<Self> {
        let access = ProtFlags::READ | ProtFlags::WRITE;
        let bytes = words * size_of::<AtomicU64>();
        // SAFETY: the kernel chooses a free address.
        let start =
            unsafe { mmap(ptr::null_mut(), bytes, access, MapFlags::SHARED, file.as_fd(), 0) }?;
        let mut mapped = Mapped { guarded: None, start: start.expose_provenance(), words };
        // Without a guard it is unmapped again.
        mapped.guarded = Guarded::watch(mapped.start, bytes, true)?;
        Ok(Self::Mapped(mapped))
    }

    pub fn own(words: usize) -> Self {
        Self::Own((0..words).map(|_| AtomicU64::new(0)).collect())
    }

    pub fn words(&self) -> &[AtomicU64] {
        match self {
            Self::Own(words) => words,
            Self::Mapped(Mapped { start, words, .. }) => {
                let first = ptr::with_exposed_provenance(*start);
                // SAFETY: the mapping has so many words, begins at a page, and stays as long as `self`. Any bytes are
                // a valid atomic, and other processes may change them.
                unsafe { std::slice::from_raw_parts(first, *words) }
            }
        }
    }
}

impl Drop for Mapped {
    fn drop(&mut self) {
        self.guarded = None;
        let start = ptr::with_exposed_provenance_mut(self.start);
        // SAFETY: nobody borrows from `self` any more, so that nobody reads the mapping. An error leaves it.
        let _ = unsafe { munmap(start, self.words * size_of::<AtomicU64>()) };
    }
}
