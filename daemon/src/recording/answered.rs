//! What an answer holds, in a form that is the same for every engine, encoding and order of pairs.

use bytemuck::{Pod, Zeroable};
use pairmask_core::mask::MaskView;
use pairmask_wire::{
    CastReply, ObserveReply, Page, Reply, ReplyError, ReplyFields, Request, ResponseHeader,
    SceneAnswerLayout, SceneReply, SceneRequest, StatusCode, words_in,
};

/// Something that an answer names: which of its sets it is of, and up to three numbers.
pub type Entry = [u32; 4];

/// Sets of an answer, by their numbers in recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Set {
    Pairs = 1,
    Begun = 2,
    Ended = 3,
    Resync = 4,
    Hits = 5,
    Detail = 6,
    /// A face of a box, or with number 6 the index's incarnation.
    Observed = 7,
}

impl Set {
    pub const fn entry(self, [a, b, more]: [u32; 3]) -> Entry {
        [self as u32, a, b, more]
    }
}

/// An answer in short, as a recording keeps it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Answered {
    /// A [`StatusCode`].
    pub status: u32,
    /// The number of the engine.
    pub engine: u32,
    /// Time in the daemon, ns.
    pub total_ns: u64,
    /// How many entries the answer has.
    pub count: u64,
    /// The sum of all entries, each mixed to 64 bits: the same in every order. 0 of an answer without entries.
    pub digest: u64,
}

impl Answered {
    /// Of an answer to a request. Each entry is passed on.
    pub fn of(
        request: &Request,
        asked: &ReplyFields,
        (header, pages): (&ResponseHeader, &[Page]),
        mut each: impl FnMut(Entry),
    ) -> Result<Self, ReplyError> {
        let mut answered = Self {
            status: header.status,
            engine: header.engine,
            total_ns: header.stages_ns[4],
            ..Self::default()
        };
        if header.status == StatusCode::Ok as u32 {
            entries(request, asked, (header, pages), |entry| {
                answered.note(entry);
                each(entry);
            })?;
        }
        Ok(answered)
    }

    /// Adds what an answer names. Each entry is passed on.
    pub fn note_all(
        &mut self,
        mut each: impl FnMut(Entry),
        read: impl FnOnce(&mut dyn FnMut(Entry)),
    ) {
        read(&mut |entry| {
            self.note(entry);
            each(entry);
        });
    }

    fn note(&mut self, entry: Entry) {
        self.count += 1;
        self.digest = self.digest.wrapping_add(mixed(entry));
    }

    /// Whether another answer has the same status and entries.
    pub fn agrees(&self, other: &Self) -> bool {
        let of = |answered: &Self| (answered.status, answered.count, answered.digest);
        of(self) == of(other)
    }
}

/// An entry as one number. Each step is a bijection of 64 bits, with the constants of `SplitMix64` (Steele, Lea, Flood
/// 2014).
fn mixed([set, a, b, more]: Entry) -> u64 {
    let mix = |value: u64| {
        let value = (value ^ value >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let value = (value ^ value >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        value ^ value >> 31
    };
    let pair = mix(u64::from(a) << 32 | u64::from(b));
    let rest = u64::from(set) << 32 | u64::from(more);
    mix(pair ^ mix(rest.wrapping_add(0x9e37_79b9_7f4a_7c15)))
}

/// Passes on what an answer names that is not an error.
pub fn entries(
    request: &Request,
    asked: &ReplyFields,
    (header, pages): (&ResponseHeader, &[Page]),
    mut each: impl FnMut(Entry),
) -> Result<(), ReplyError> {
    let payload_bytes = size_of_val(pages) as u64;
    match request {
        Request::Cull(_) | Request::QueryScene(_) => {
            let reply = Reply::parse(header, asked, payload_bytes)?;
            let mask = MaskView::new(asked.box_count, &reply.report.shape, words_in(pages))
                .map_err(|_| ReplyError::Malformed { field: "mask" })?;
            mask.for_each(|a, b| each(Set::Pairs.entry([a, b, 0])));
        }
        Request::EditScene(request) | Request::CommitShared(request) => {
            let reply = SceneReply::parse(header, asked, payload_bytes)?;
            changes(request, &reply, words_in(pages), each);
        }
        Request::CastScene(request) => {
            let reply = CastReply::parse(header, asked, payload_bytes)?;
            // The daemon says in no answer up to where indices of the scene go.
            for hit in reply.read(pages, request, u32::MAX)? {
                each(Set::Hits.entry([hit.query, hit.index, hit.distance.to_bits()]));
            }
        }
        Request::LeaseShared(_) => {
            Reply::check_envelope(header, asked)?;
            for (at, detail) in header.detail.iter().enumerate() {
                each(Set::Detail.entry([(detail >> 32) as u32, *detail as u32, at as u32]));
            }
        }
        Request::ObserveShared(_) => {
            let reply = ObserveReply::parse(header, asked, payload_bytes)?;
            for observed in reply.read(pages, u32::MAX)?.boxes {
                let [min, max] =
                    [observed.aabb.min, observed.aabb.max].map(|c| c.map(f32::to_bits));
                let facts = min.into_iter().chain(max).chain([observed.incarnation]);
                for (at, fact) in (0..).zip(facts) {
                    each(Set::Observed.entry([observed.index, at, fact]));
                }
            }
        }
        // What a member joins with may be left open by all.
        Request::JoinShared(_)
        | Request::EndScene(_)
        | Request::LeaveShared(_)
        | Request::Status => {
            Reply::check_envelope(header, asked)?;
        }
    }
    Ok(())
}

fn changes(request: &SceneRequest, reply: &SceneReply, words: &[u32], mut each: impl FnMut(Entry)) {
    let pairs_in = |span| SceneAnswerLayout::pairs_in(span, words);
    for [a, b] in pairs_in(&reply.layout.begun) {
        each(Set::Begun.entry([*a, *b, 0]));
    }
    for ended in reply.layout.ended_in(words, request.most_boxes) {
        let [a, b] = ended.pair;
        each(Set::Ended.entry([a, b, ended.reason as u32]));
    }
    for [a, b] in pairs_in(&reply.layout.pairs) {
        each(Set::Pairs.entry([*a, *b, 0]));
    }
    if reply.is_resync {
        each(Set::Resync.entry([0; 3]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_depends_on_every_number_of_every_entry() {
        let sum =
            |entries: &[Entry]| entries.iter().fold(0u64, |sum, e| sum.wrapping_add(mixed(*e)));
        let entries = [[1, 0, 1, 0], [1, 1, 0, 0], [2, 0, 1, 0], [1, 0, 1, 1], [1, 0, 0, 0]];
        let right = sum(&entries);
        let mut turned = entries;
        for _ in 0..entries.len() {
            turned.rotate_left(1);
            assert_eq!(sum(&turned), right, "another order");
        }
        for at in 0..entries.len() {
            for number in 0..4 {
                for bit in 0..32 {
                    let mut changed = entries;
                    changed[at][number] ^= 1 << bit;
                    assert_ne!(sum(&changed), right, "{at} {number} {bit}");
                }
            }
            assert_ne!(sum(&entries[..at]), right, "only {at}");
        }
        // What two pairs exchange is noticed.
        assert_ne!(sum(&[[1, 2, 5, 0], [1, 3, 4, 0]]), sum(&[[1, 2, 4, 0], [1, 3, 5, 0]]));
    }
}
