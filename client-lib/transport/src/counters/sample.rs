//! The counters as a reader copies them. It asks the worker nothing, and the file may hold anything.

use bytemuck::{Pod, Zeroable};

use super::layout::{ClientCounts, GpuRecord, Head, SceneCounts, Table, TotalCounts, text_of};

/// What the counters were at a moment. Words of one record may be of moments a frame apart.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CounterSample {
    /// The process that counts: session numbers are its own.
    pub worker: u32,
    /// All together.
    pub totals: TotalCounts,
    /// Names of the GPUs.
    pub gpus: Vec<String>,
    /// Clients that are connected, by session.
    pub clients: Vec<ClientCounts>,
    /// Scenes that there are, by number.
    pub scenes: Vec<SceneCounts>,
}

impl CounterSample {
    /// Of two copies of a file, one after the other. Records are those of the first; one that has another number in the
    /// second changed hands meanwhile, and is left out: it may be a mixture of two clients.
    pub fn parse(first: &[u8], second: &[u8]) -> Option<Self> {
        let head: Head = copied(first)?;
        if copied::<Head>(second)? != head {
            return None;
        }
        let layout = head.layout()?;
        let both = |table: &Table| {
            let table = *table;
            (0..table.count).map(move |at| [first, second].map(|copy| (copy, table.record(at))))
        };
        let mut clients: Vec<ClientCounts> = both(&layout.clients)
            .map(|copies| copies.map(|(copy, place)| record::<ClientCounts>(copy, &place)))
            .filter(|[one, two]| one.session == two.session && two.session != 0)
            .map(|[one, _]| one)
            .collect();
        let mut scenes: Vec<SceneCounts> = both(&layout.scenes)
            .map(|copies| copies.map(|(copy, place)| record::<SceneCounts>(copy, &place)))
            .filter(|[one, two]| one.number == two.number && two.number != 0)
            .map(|[one, _]| one)
            .collect();
        clients.sort_by_key(|client| client.session);
        clients.dedup_by_key(|client| client.session);
        scenes.sort_by_key(|scene| scene.number);
        scenes.dedup_by_key(|scene| scene.number);
        let gpus = both(&layout.gpus).map(|[(copy, place), _]| record::<GpuRecord>(copy, &place));
        Some(Self {
            worker: u32::try_from(head.worker).ok()?,
            totals: record(first, &layout.totals.record(0)),
            gpus: gpus.map(|gpu| text_of(&gpu.name)).take_while(|name| !name.is_empty()).collect(),
            clients,
            scenes,
        })
    }
}

fn copied<T: Pod>(bytes: &[u8]) -> Option<T> {
    Some(bytemuck::pod_read_unaligned(bytes.get(..size_of::<T>())?))
}

/// A record; zeros for words that the file does not have.
fn record<T: Pod + Zeroable>(bytes: &[u8], place: &std::ops::Range<usize>) -> T {
    let mut whole = T::zeroed();
    let there = bytes.get(8 * place.start..).unwrap_or_default();
    let len = size_of::<T>().min(8 * place.len()).min(there.len());
    bytemuck::bytes_of_mut(&mut whole)[..len].copy_from_slice(&there[..len]);
    whole
}
