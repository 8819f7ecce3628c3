//! What lies where in the file of the counters: a head, then tables of records, all of u64 words.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

/// "PMCOUNTS" in memory order.
const MAGIC: u64 = u64::from_le_bytes(*b"PMCOUNTS");

/// Raised where a word changes its meaning. Words that are added behind those of a record leave it as it is: readers
/// skip what they do not know.
const VERSION: u64 = 1;

/// Words of a cache line, which a record has for itself: threads that serve two clients do not wait for each other.
const LINE_WORDS: u64 = 8;

/// GPUs whose names are noted, at most: more than machines have.
pub(super) const MOST_GPUS: usize = 16;

/// Records of scenes for each client: most have one or two. Scenes beyond them are counted with their clients alone.
const SCENES_A_CLIENT: usize = 4;
/// Records of scenes at most: half a MiB of the file.
const MOST_SCENES: usize = 4096;

/// Records for clients that are gone while a request of theirs is still served.
const LEAVING_CLIENTS: usize = 16;

/// Length of a file at most, for readers, bytes: three times that of a daemon for 65,535 clients.
pub(super) const MOST_BYTES: u64 = 64 << 20;

/// All clients and scenes of a worker together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct TotalCounts {
    /// How long the worker had served when it noted memory and CPU time last, ns: twice a second.
    pub uptime_ns: u64,
    /// Frames, edits, queries and casts that were answered.
    pub frames: u64,
    /// Boxes that these carried.
    pub boxes: u64,
    /// Spheres that these carried.
    pub spheres: u64,
    /// Pairs and hits that they were answered with.
    pub pairs: u64,
    /// Requests that were answered with an error.
    pub errors: u64,
    /// Bytes of requests.
    pub received_bytes: u64,
    /// Bytes of answers, in whole pages.
    pub sent_bytes: u64,
    /// Requests that wait.
    pub waiting: u64,
    /// Requests that are being served.
    pub serving: u64,
    /// Memory that the worker and its clients take.
    pub memory_bytes: u64,
    /// The most that they may take.
    pub memory_limit_bytes: u64,
    /// CPU time of the worker since it began, ns.
    pub cpu_ns: u64,
    /// Time that GPUs took for requests, ns.
    pub gpu_ns: u64,
}

/// One GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GpuRecord {
    /// Its name, UTF-8 with zeros behind.
    pub name: [u64; 8],
}

/// One session of a client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ClientCounts {
    /// Number of the session, never used again by its worker. 0: the record is free.
    pub session: u64,
    /// Id of its process, 0 where that is in another PID namespace.
    pub process: u64,
    /// Its user.
    pub user: u64,
    /// The name of its process, UTF-8 with zeros behind.
    pub name: [u64; 2],
    /// What the client calls itself in requests: errors name it.
    pub token: u64,
    /// When it connected, ns after the worker began.
    pub connected_at_ns: u64,
    /// As of [`TotalCounts`].
    pub frames: u64,
    /// Those of them that changed a scene.
    pub edits: u64,
    /// Those of them that asked something of a scene.
    pub queries: u64,
    /// As of [`TotalCounts`]; spheres are among them.
    pub boxes: u64,
    /// Boxes that edits set.
    pub moved: u64,
    /// Boxes in the scene after each edit, summed: of so many, `moved` did.
    pub kept: u64,
    /// As of [`TotalCounts`].
    pub pairs: u64,
    /// As of [`TotalCounts`].
    pub errors: u64,
    /// Boxes of its last frame, or in the scene after its last edit.
    pub last_boxes: u64,
    /// Pairs of its last frame, or of the scene after its last edit.
    pub last_pairs: u64,
    /// Wire number of the engine that answered last; 0 is none.
    pub engine: u64,
    /// Threads that it could use.
    pub threads: u64,
    /// Time from a request's receipt until its turn, ns; this and the following are sums.
    pub wait_ns: u64,
    /// Time to read boxes, ns.
    pub ingest_ns: u64,
    /// Time to plan, ns.
    pub plan_ns: u64,
    /// Time to find pairs, ns.
    pub execute_ns: u64,
    /// Time to write answers, ns.
    pub publish_ns: u64,
    /// Time from a request's turn to its answer, ns.
    pub total_ns: u64,
    /// CPU time of all threads that served it, or time on a GPU, ns.
    pub used_ns: u64,
    /// As of [`TotalCounts`].
    pub received_bytes: u64,
    /// As of [`TotalCounts`].
    pub sent_bytes: u64,
    /// Memory that it takes of its share of the budget.
    pub memory_bytes: u64,
}

/// One scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct SceneCounts {
    /// Number of the scene, never used again by its worker. 0: the record is free.
    pub number: u64,
    /// The session that it belongs to; 0 where several share it.
    pub session: u64,
    /// The session's name of it.
    pub scene: u64,
    /// Edits, or ticks of a shared scene, that were applied.
    pub edits: u64,
    /// As of [`ClientCounts`].
    pub moved: u64,
    /// As of [`ClientCounts`].
    pub kept: u64,
    /// Boxes in it.
    pub boxes: u64,
    /// Pairs in it.
    pub pairs: u64,
    /// As of [`ClientCounts`].
    pub engine: u64,
    /// As of [`ClientCounts`].
    pub ingest_ns: u64,
    /// As of [`ClientCounts`].
    pub execute_ns: u64,
    /// Memory that it takes.
    pub memory_bytes: u64,
}

/// The first words of the file. They are there before the file has its name, and never change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Head {
    magic: u64,
    version: u64,
    pub worker: u64,
    /// Of the table of totals, GPUs, clients and scenes, which follow each other: words of a record, and records.
    tables: [[u64; 2]; 4],
    reserved: [u64; 5],
}

const _: () = assert!(size_of::<Head>().is_multiple_of(8 * LINE_WORDS as usize));

/// Where the records of a table lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Table {
    start: usize,
    words: usize,
    pub count: usize,
}

impl Table {
    /// The words of a record.
    pub fn record(&self, at: usize) -> Range<usize> {
        let start = self.start + at * self.words;
        start..start + self.words
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub totals: Table,
    pub gpus: Table,
    pub clients: Table,
    pub scenes: Table,
    pub words: usize,
}

const fn lines<T>() -> u64 {
    (size_of::<T>() as u64).div_ceil(8 * LINE_WORDS) * LINE_WORDS
}

impl Head {
    pub fn new(worker: u32, clients: usize) -> Self {
        let scenes = (clients * SCENES_A_CLIENT).min(MOST_SCENES);
        let clients = clients + LEAVING_CLIENTS;
        Self {
            magic: MAGIC,
            version: VERSION,
            worker: worker.into(),
            tables: [
                [lines::<TotalCounts>(), 1],
                [lines::<GpuRecord>(), MOST_GPUS as u64],
                [lines::<ClientCounts>(), clients as u64],
                [lines::<SceneCounts>(), scenes as u64],
            ],
            reserved: [0; 5],
        }
    }

    /// The tables behind it; `None` where they would not fit a file, or it is of another version.
    pub fn layout(&self) -> Option<Layout> {
        if (self.magic, self.version) != (MAGIC, VERSION) {
            return None;
        }
        let mut end = size_of::<Self>() as u64 / 8;
        let mut tables = self.tables.iter().map(|[words, count]| {
            let start = end;
            end = end.checked_add(words.checked_mul(*count)?).filter(|e| *e <= MOST_BYTES / 8)?;
            // Each is at most the end, or has no words.
            let number = |n: u64| usize::try_from(n).ok();
            Some(Table { start: number(start)?, words: number(*words)?, count: number(*count)? })
        });
        let mut next = || tables.next().flatten().filter(|table| table.words > 0);
        let (totals, gpus, clients, scenes) = (next()?, next()?, next()?, next()?);
        (totals.count > 0).then_some(())?;
        Some(Layout { totals, gpus, clients, scenes, words: end as usize })
    }
}

/// Text as words: as much as there is room for, zeros behind, no control characters.
pub(super) fn words_of<const N: usize>(text: &str) -> [u64; N] {
    let mut words = [0; N];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
    let mut len = 0;
    for c in text.chars().filter(|c| !c.is_control()) {
        let Some(room) = bytes.get_mut(len..len + c.len_utf8()) else { break };
        c.encode_utf8(room);
        len += c.len_utf8();
    }
    words
}

/// Text of words that anybody may have written.
pub(super) fn text_of(words: &[u64]) -> String {
    let bytes: &[u8] = bytemuck::cast_slice(words);
    let text = bytes.split(|byte| *byte == 0).next().unwrap_or_default();
    String::from_utf8_lossy(text).chars().filter(|c| !c.is_control()).collect()
}

impl ClientCounts {
    /// The name of its process.
    pub fn process_name(&self) -> String {
        text_of(&self.name)
    }
}
