//! Counters of a worker: what each client, each scene and all of them took.
//!
//! The worker adds to them as it serves, by relaxed atomic operations on a file of the instance that it maps
//! (`NAME.counters`). Who may read the file copies it, without the worker's help, and also after the worker was killed.
//! A worker makes a new file; one that stops by itself removes it.
//!
//! ```text
//! Head           what lies behind it: words of a record, and records, of each table
//! TotalCounts    once
//! GPUs           their names
//! ClientCounts   one for each session that may be connected; that of a free record is 0
//! SceneCounts    one for each scene, as far as there are records
//! ```
//!
//! All is u64, little-endian. A record has whole cache lines. Its first word is the number of a client or scene, which is
//! taken away first and written last when the record is claimed, and is never used again: what was read between two
//! looks at the same number is of one client (`sample`).
//! Sums wrap around; a reader takes differences.

mod layout;
mod memory;
mod sample;

use std::fs::{self, OpenOptions, Permissions};
use std::io::Write;
use std::mem::offset_of;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering, fence};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use pairmask_core::EngineName;
use pairmask_core::dispatch::StageTimes;
use pairmask_wire::{InstanceError, InstanceName};

pub use self::layout::{ClientCounts, SceneCounts, TotalCounts};
pub use self::sample::CounterSample;

use self::layout::{GpuRecord, Head, Layout, MOST_BYTES, Table, words_of};
use self::memory::Memory;
use crate::instance::RuntimeDir;
use crate::liveness::process_name;
use crate::locked::lock;
use crate::trust::{check_file, io_error, open_plain, read_own};

/// Copies of the file are made anew so many times where a worker's successor replaces it meanwhile.
const COPIES: usize = 3;

/// The word of a field in its record.
macro_rules! word {
    ($record:ty, $field:ident) => {
        offset_of!($record, $field) / size_of::<u64>()
    };
}

/// The counters of this process.
#[derive(Debug)]
pub struct Counters {
    memory: Memory,
    layout: Layout,
    begun: Instant,
    free_clients: Mutex<Vec<usize>>,
    free_scenes: Mutex<Free>,
}

#[derive(Debug)]
struct Free {
    records: Vec<usize>,
    last_number: u64,
}

/// What an answer that was found is counted as.
#[derive(Clone, Copy, Debug)]
pub struct Answered {
    /// What its client calls itself.
    pub token: u64,
    /// Boxes or spheres that the request carried.
    pub objects: u64,
    /// Pairs or hits in the answer.
    pub pairs: u64,
    /// What it was.
    pub of: AnsweredOf,
    /// Which engine found it.
    pub engine: EngineName,
    /// Threads that the engine could use.
    pub threads: usize,
    /// Time by stage.
    pub times: StageTimes,
}

/// What an answer is of.
#[derive(Clone, Copy, Debug)]
pub enum AnsweredOf {
    /// A frame.
    Frame,
    /// An edit.
    Edit {
        /// Boxes in the scene after it.
        boxes: u64,
        /// Pairs in the scene after it; `None` where the client asked for others alone.
        pairs: Option<u64>,
    },
    /// A query or a cast.
    Query,
}

/// What a worker has answered so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct AnsweredTotals {
    /// As of [`TotalCounts`], like the following.
    pub frames: u64,
    /// Boxes.
    pub boxes: u64,
    /// Spheres.
    pub spheres: u64,
    /// Pairs.
    pub pairs: u64,
    /// Errors.
    pub errors: u64,
}

/// The memory and time of a worker.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProcessNote {
    /// As of [`TotalCounts`], like the following.
    pub memory_bytes: u64,
    /// The most.
    pub memory_limit_bytes: u64,
    /// CPU time.
    pub cpu_ns: u64,
}

impl Counters {
    /// Makes the file of an instance, in place of a predecessor's, for so many clients.
    ///
    /// # Errors
    /// [`InstanceError`]: then [`unseen`](Self::unseen) ones do.
    pub fn create(
        dir: &RuntimeDir,
        name: &InstanceName,
        clients: usize,
    ) -> Result<Arc<Self>, InstanceError> {
        let (new, path) = (dir.file(name, ".counters.new"), dir.counters_file(name));
        let (head, layout) = head_of(clients);
        // One that a predecessor left half made.
        let _ = fs::remove_file(&new);
        let mut options = OpenOptions::new();
        options.create_new(true).read(true).write(true);
        let mut file = open_plain(&new, options.mode(0o644))?;
        check_file(&new, &file)?;
        let mode = if dir.group().is_some() { 0o640 } else { 0o644 };
        let system = |error| io_error(&new)(error);
        file.set_permissions(Permissions::from_mode(mode)).map_err(system)?;
        // Written as a whole: a hole could not be filled on a full disk.
        let mut bytes = vec![0; layout.words * size_of::<u64>()];
        bytes[..size_of::<Head>()].copy_from_slice(bytemuck::bytes_of(&head));
        file.write_all(&bytes).map_err(system)?;
        let memory = Memory::map(&file, layout.words).map_err(system)?;
        fs::rename(&new, &path).map_err(io_error(&path))?;
        Ok(Self::of(memory, layout))
    }

    /// Counters that nobody else sees.
    pub fn unseen(clients: usize) -> Arc<Self> {
        let (_, layout) = head_of(clients);
        Self::of(Memory::own(layout.words), layout)
    }

    fn of(memory: Memory, layout: Layout) -> Arc<Self> {
        let free = |table: &Table| (0..table.count).rev().collect();
        Arc::new(Self {
            memory,
            layout,
            begun: Instant::now(),
            free_clients: Mutex::new(free(&layout.clients)),
            free_scenes: Mutex::new(Free { records: free(&layout.scenes), last_number: 0 }),
        })
    }

    fn record(&self, table: &Table, at: usize) -> Record<'_> {
        Record(self.memory.words().get(table.record(at)).unwrap_or_default())
    }

    fn totals(&self) -> Record<'_> {
        self.record(&self.layout.totals, 0)
    }

    /// Nanoseconds since these counters began.
    fn now_ns(&self) -> u64 {
        self.begun.elapsed().as_nanos() as u64
    }

    /// Notes what was answered so far.
    pub fn note_answered(&self, answered: AnsweredTotals) {
        let (AnsweredTotals { frames, boxes, spheres, pairs, errors }, of) =
            (answered, self.totals());
        of.set(word!(TotalCounts, frames), frames);
        of.set(word!(TotalCounts, boxes), boxes);
        of.set(word!(TotalCounts, spheres), spheres);
        of.set(word!(TotalCounts, pairs), pairs);
        of.set(word!(TotalCounts, errors), errors);
    }

    /// Notes how many requests wait, and are being served.
    pub fn note_queue(&self, waiting: usize, serving: usize) {
        let of = self.totals();
        of.set(word!(TotalCounts, waiting), waiting as u64);
        of.set(word!(TotalCounts, serving), serving as u64);
    }

    /// Notes memory and CPU time, now and then.
    pub fn note_process(&self, note: ProcessNote) {
        let (ProcessNote { memory_bytes, memory_limit_bytes, cpu_ns }, of) = (note, self.totals());
        of.set(word!(TotalCounts, uptime_ns), self.now_ns());
        of.set(word!(TotalCounts, memory_bytes), memory_bytes);
        of.set(word!(TotalCounts, memory_limit_bytes), memory_limit_bytes);
        of.set(word!(TotalCounts, cpu_ns), cpu_ns);
    }

    /// Notes the names of the GPUs, as many as there is room for.
    pub fn note_gpus<'a>(&self, names: impl Iterator<Item = &'a str>) {
        for (at, name) in (0..self.layout.gpus.count).zip(names) {
            let record = self.record(&self.layout.gpus, at);
            record.set_all(word!(GpuRecord, name), &words_of::<8>(name));
        }
    }

    /// The record of a client that connects. Where all are in use, it is counted in the totals alone.
    pub fn client(self: &Arc<Self>, session: u64, process: u32, user: u32) -> ClientSlot {
        let slot = ClientSlot { of: Arc::clone(self), at: lock(&self.free_clients).pop() };
        let record = slot.record();
        record.clear();
        record.set(word!(ClientCounts, process), process.into());
        record.set(word!(ClientCounts, user), user.into());
        if process > 0 {
            let name = words_of::<2>(&process_name(process));
            record.set_all(word!(ClientCounts, name), &name);
        }
        record.set(word!(ClientCounts, connected_at_ns), self.now_ns());
        record.publish(word!(ClientCounts, session), session);
        slot
    }

    /// The record of a new scene; session 0 where it is shared.
    pub fn scene(self: &Arc<Self>, session: u64, scene: u64) -> SceneSlot {
        let mut free = lock(&self.free_scenes);
        free.last_number += 1;
        let number = free.last_number;
        let slot = SceneSlot { of: Arc::clone(self), at: free.records.pop() };
        drop(free);
        let record = slot.record();
        record.clear();
        record.set(word!(SceneCounts, session), session);
        record.set(word!(SceneCounts, scene), scene);
        record.publish(word!(SceneCounts, number), number);
        slot
    }
}

fn head_of(clients: usize) -> (Head, Layout) {
    // All that may connect, up to 65,535, fit the longest file.
    let head = Head::new(std::process::id(), clients.min(usize::from(u16::MAX)));
    let layout = head.layout().unwrap_or_else(|| unreachable!("a layout of this version"));
    (head, layout)
}

const _: () =
    assert!(offset_of!(ClientCounts, session) == 0 && offset_of!(SceneCounts, number) == 0);

/// Words of one record; none where there is no record.
#[derive(Clone, Copy)]
struct Record<'a>(&'a [AtomicU64]);

impl Record<'_> {
    // Relaxed: each word is a number of its own.
    fn add(&self, word: usize, by: u64) {
        if let Some(word) = self.0.get(word) {
            word.fetch_add(by, Ordering::Relaxed);
        }
    }

    fn set(&self, word: usize, to: u64) {
        if let Some(word) = self.0.get(word) {
            word.store(to, Ordering::Relaxed);
        }
    }

    fn set_all(&self, first: usize, to: &[u64]) {
        to.iter().zip(first..).for_each(|(to, word)| self.set(word, *to));
    }

    /// Makes it nobody's, and then empty: the number is the first word.
    fn clear(&self) {
        self.set(0, 0);
        fence(Ordering::Release);
        self.0.iter().for_each(|word| word.store(0, Ordering::Relaxed));
    }

    /// Gives the record its number, behind all that was written to it.
    fn publish(&self, word: usize, number: u64) {
        if let Some(word) = self.0.get(word) {
            word.store(number, Ordering::Release);
        }
    }
}

/// The record of a connected client, which is free again when this is dropped.
#[derive(Debug)]
pub struct ClientSlot {
    of: Arc<Counters>,
    at: Option<usize>,
}

impl ClientSlot {
    fn record(&self) -> Record<'_> {
        self.at.map_or(Record(&[]), |at| self.of.record(&self.of.layout.clients, at))
    }

    /// A request was received that has so many bytes, after it waited for its turn.
    pub fn note_received(&self, bytes: u64, wait_ns: u64) {
        let of = self.record();
        of.add(word!(ClientCounts, received_bytes), bytes);
        of.add(word!(ClientCounts, wait_ns), wait_ns);
        self.of.totals().add(word!(TotalCounts, received_bytes), bytes);
    }

    /// An answer was found, and is sent next.
    pub fn note_answered(&self, answered: &Answered) {
        let (Answered { token, objects, pairs, of, engine, threads, times }, record) =
            (*answered, self.record());
        record.set(word!(ClientCounts, token), token);
        record.add(word!(ClientCounts, frames), 1);
        record.add(word!(ClientCounts, boxes), objects);
        record.add(word!(ClientCounts, pairs), pairs);
        let last = match of {
            AnsweredOf::Frame => Some((objects, Some(pairs))),
            AnsweredOf::Edit { boxes, pairs } => {
                record.add(word!(ClientCounts, edits), 1);
                record.add(word!(ClientCounts, moved), objects);
                record.add(word!(ClientCounts, kept), boxes);
                Some((boxes, pairs))
            }
            AnsweredOf::Query => {
                record.add(word!(ClientCounts, queries), 1);
                None
            }
        };
        if let Some((boxes, pairs)) = last {
            record.set(word!(ClientCounts, last_boxes), boxes);
            if let Some(pairs) = pairs {
                record.set(word!(ClientCounts, last_pairs), pairs);
            }
            record.set(word!(ClientCounts, engine), engine as u64);
            record.set(word!(ClientCounts, threads), threads as u64);
        }
        record.add(word!(ClientCounts, ingest_ns), times.ingest_ns);
        record.add(word!(ClientCounts, plan_ns), times.plan_ns);
        record.add(word!(ClientCounts, execute_ns), times.execute_ns);
        record.add(word!(ClientCounts, publish_ns), times.publish_ns);
        record.add(word!(ClientCounts, total_ns), times.total_ns);
        if engine.is_gpu() {
            self.of.totals().add(word!(TotalCounts, gpu_ns), times.execute_ns);
        }
    }

    /// An answer of so many bytes is sent, while the client takes so much memory.
    pub fn note_sent(&self, bytes: u64, memory_bytes: u64) {
        let of = self.record();
        of.add(word!(ClientCounts, sent_bytes), bytes);
        of.set(word!(ClientCounts, memory_bytes), memory_bytes);
        self.of.totals().add(word!(TotalCounts, sent_bytes), bytes);
    }

    /// A request is answered with an error.
    pub fn note_error(&self) {
        self.record().add(word!(ClientCounts, errors), 1);
    }

    /// The client is gone: its record is nobody's from now on, and is used again when this is dropped.
    pub(super) fn end(&self) {
        self.record().set(word!(ClientCounts, session), 0);
    }

    /// A request has taken so much time of threads or a GPU.
    pub fn note_used(&self, ns: u64) {
        self.record().add(word!(ClientCounts, used_ns), ns);
    }
}

impl Drop for ClientSlot {
    fn drop(&mut self) {
        if let Some(at) = self.at {
            self.end();
            lock(&self.of.free_clients).push(at);
        }
    }
}

/// The record of a scene, which is free again when this is dropped.
#[derive(Debug)]
pub struct SceneSlot {
    of: Arc<Counters>,
    at: Option<usize>,
}

impl SceneSlot {
    fn record(&self) -> Record<'_> {
        self.at.map_or(Record(&[]), |at| self.of.record(&self.of.layout.scenes, at))
    }

    /// An edit, or a tick of a shared scene, was applied that set so many boxes of so many. The scene has so many pairs
    /// now, where that is known.
    pub fn note_edit(
        &self,
        (moved, boxes): (u64, u64),
        pairs: Option<u64>,
        engine: EngineName,
        times: &StageTimes,
    ) {
        let of = self.record();
        of.add(word!(SceneCounts, edits), 1);
        of.add(word!(SceneCounts, moved), moved);
        of.add(word!(SceneCounts, kept), boxes);
        if let Some(pairs) = pairs {
            of.set(word!(SceneCounts, pairs), pairs);
        }
        of.set(word!(SceneCounts, engine), engine as u64);
        of.add(word!(SceneCounts, ingest_ns), times.ingest_ns);
        of.add(word!(SceneCounts, execute_ns), times.execute_ns);
    }

    /// The scene has so many boxes, and takes so much memory.
    pub fn note_size(&self, boxes: u64, memory_bytes: u64) {
        let of = self.record();
        of.set(word!(SceneCounts, boxes), boxes);
        of.set(word!(SceneCounts, memory_bytes), memory_bytes);
    }
}

impl Drop for SceneSlot {
    fn drop(&mut self) {
        if let Some(at) = self.at {
            self.record().set(word!(SceneCounts, number), 0);
            lock(&self.of.free_scenes).records.push(at);
        }
    }
}

impl RuntimeDir {
    pub(super) fn counters_file(&self, name: &InstanceName) -> PathBuf {
        self.file(name, ".counters")
    }

    /// The counters of an instance; `None` where there is no file, or none of this version.
    ///
    /// # Errors
    /// [`InstanceError`] where the file is not this user's alone.
    pub fn read_counters(
        &self,
        name: &InstanceName,
    ) -> Result<Option<CounterSample>, InstanceError> {
        let path = self.counters_file(name);
        for _ in 0..COPIES {
            let [first, second] = [(); 2].map(|()| read_own(&path, MOST_BYTES));
            let (Some(first), Some(second)) = (first?, second?) else { return Ok(None) };
            if let Some(sample) = CounterSample::parse(&first, &second) {
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
