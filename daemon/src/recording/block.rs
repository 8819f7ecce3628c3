//! Records in a block, which is compressed and read as a whole.
//!
//! Frames of one client differ little from one another: the payload of a request is kept as its difference (XOR) to that
//! of the session's last request of the same kind and layout in the block, the first bytes of all words before the
//! second ones. What did not move is then zeros, and of what moved a little so are the upper bytes of its floats. LZ4
//! does the rest. The decoder has no `unsafe` code and no C, since it reads files that others have written.

use std::collections::HashMap;
use std::hash::BuildHasherDefault;
use std::hash::DefaultHasher;

use bytemuck::{Pod, Zeroable};
use pairmask_wire::{RequestHeader, SECTION_COUNT, Section};

use super::Answered;
use super::record::{Event, MOST_PAYLOAD_BYTES, Record, SessionEnd, parsed};

/// Bytes of records from which on a block is closed: LZ4 gains nothing by more, and a reader holds one block.
pub(super) const BLOCK_BYTES: usize = 1 << 20;

/// The most bytes of the records of a block: one that is nearly full takes the largest record.
const MOST_BLOCK_BYTES: usize = BLOCK_BYTES + MOST_PAYLOAD_BYTES + (1 << 10);

/// The most that LZ4 makes of a byte.
const MOST_GROWTH: usize = 255;

/// "PMBL" in memory order.
const BLOCK_MAGIC: u32 = u32::from_le_bytes(*b"PMBL");

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct BlockHeader {
    magic: u32,
    /// Bytes that follow.
    packed_bytes: u32,
    /// Bytes of the records.
    bytes: u32,
    records: u32,
}

/// What stands before each record.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct RecordHeader {
    /// Bytes of the record behind this header.
    bytes: u32,
    /// CRC32 of what follows this field.
    crc: u32,
    kind: u32,
    /// Of a request: 1 its payload is a difference. Of an end: why.
    flags: u32,
    at_ns: u64,
    session: u64,
    number: u64,
}

/// Bytes of a record's header that its check covers not.
const UNCHECKED_BYTES: usize = 8;

const REQUEST: u32 = 1;
const ANSWER: u32 = 2;
const SESSION_ENDED: u32 = 3;
const WORKER_BEGAN: u32 = 4;

const DIFFERENCE: u32 = 1;

/// What a block is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Damage(pub(super) &'static str);

/// The last request of a kind of a session in a block.
struct Last {
    sections: [Section; SECTION_COUNT],
    payload: Vec<u8>,
}

/// Those that a difference may be to, by session and operation. The hasher's keys are fixed: what a file says in its
/// numbers makes reading it slow at worst.
type Lasts = HashMap<(u64, u32), Last, BuildHasherDefault<DefaultHasher>>;

fn last_of<'a>(lasts: &'a Lasts, session: u64, header: &RequestHeader) -> Option<&'a [u8]> {
    let last = lasts.get(&(session, header.operation))?;
    (last.sections == header.sections).then_some(&last.payload)
}

fn keep(lasts: &mut Lasts, session: u64, header: &RequestHeader, payload: &[u8]) {
    let last = Last { sections: header.sections, payload: payload.to_vec() };
    lasts.insert((session, header.operation), last);
}

/// A block that is being filled.
#[derive(Default)]
pub(super) struct Filling {
    bytes: Vec<u8>,
    records: u32,
    lasts: Lasts,
}

impl Filling {
    pub fn is_empty(&self) -> bool {
        self.records == 0
    }

    pub fn is_full(&self) -> bool {
        self.bytes.len() >= BLOCK_BYTES
    }

    pub fn push(&mut self, record: &Record) {
        let (mut session, mut number, mut flags) = (0, 0, 0);
        let mut body = Vec::new();
        let kind = match &record.event {
            Event::Request { session: of, number: counted, header, payload } => {
                (session, number) = (*of, *counted);
                body.extend_from_slice(bytemuck::bytes_of(&**header));
                let last = last_of(&self.lasts, *of, header).filter(|l| l.len() == payload.len());
                flags = if last.is_some() { DIFFERENCE } else { 0 };
                body.extend(to_planes(&difference(payload, last.unwrap_or_default())));
                keep(&mut self.lasts, *of, header, payload);
                REQUEST
            }
            Event::Answer { number: counted, answered } => {
                number = *counted;
                body.extend_from_slice(bytemuck::bytes_of(answered));
                ANSWER
            }
            Event::SessionEnded { session: of, why } => {
                (session, flags) = (*of, *why as u32);
                SESSION_ENDED
            }
            Event::WorkerBegan => WORKER_BEGAN,
        };
        let bytes = body.len() as u32;
        let mut header =
            RecordHeader { bytes, crc: 0, kind, flags, at_ns: record.at_ns, session, number };
        header.crc = check(&header, &body);
        self.bytes.extend_from_slice(bytemuck::bytes_of(&header));
        self.bytes.extend_from_slice(&body);
        self.records += 1;
    }

    /// The block, with its header. What follows begins another one.
    pub fn close(&mut self) -> Vec<u8> {
        let packed = lz4_flex::block::compress(&self.bytes);
        let header = BlockHeader {
            magic: BLOCK_MAGIC,
            packed_bytes: packed.len() as u32,
            bytes: self.bytes.len() as u32,
            records: self.records,
        };
        *self = Self::default();
        [bytemuck::bytes_of(&header), &packed].concat()
    }
}

fn check(header: &RecordHeader, body: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&bytemuck::bytes_of(header)[UNCHECKED_BYTES..]);
    hasher.update(body);
    hasher.finalize()
}

impl BlockHeader {
    /// Bytes behind the header.
    pub fn packed_bytes(&self) -> Result<usize, Damage> {
        let (packed, bytes) = (self.packed_bytes as usize, self.bytes as usize);
        let is_block = self.magic == BLOCK_MAGIC
            && bytes <= MOST_BLOCK_BYTES
            && bytes <= packed.saturating_mul(MOST_GROWTH)
            && packed <= lz4_flex::block::get_maximum_output_size(bytes);
        if is_block { Ok(packed) } else { Err(Damage("no block begins there")) }
    }

    /// The records of a block whose header this is.
    pub fn records(&self, packed: &[u8]) -> Result<Vec<Record>, Damage> {
        self.packed_bytes()?;
        let mut bytes = vec![0; self.bytes as usize];
        let written = lz4_flex::block::decompress_into(packed, &mut bytes);
        if written.ok() != Some(bytes.len()) {
            return Err(Damage("a block cannot be decompressed"));
        }
        let (mut rest, mut lasts, mut records) = (&bytes[..], Lasts::default(), Vec::new());
        while !rest.is_empty() {
            records.push(next_record(&mut rest, &mut lasts)?);
        }
        if records.len() == self.records as usize {
            Ok(records)
        } else {
            Err(Damage("a block has other records than it says"))
        }
    }
}

fn next_record(rest: &mut &[u8], lasts: &mut Lasts) -> Result<Record, Damage> {
    const CUT: Damage = Damage("a record leaves its block");
    const UNKNOWN: Damage = Damage("a record is none that this version knows");
    let (header, behind) = rest.split_at_checked(size_of::<RecordHeader>()).ok_or(CUT)?;
    let header: RecordHeader = bytemuck::pod_read_unaligned(header);
    let (body, behind) = behind.split_at_checked(header.bytes as usize).ok_or(CUT)?;
    if check(&header, body) != header.crc {
        return Err(Damage("a record is not what was written"));
    }
    *rest = behind;
    let RecordHeader { kind, flags, at_ns, session, number, .. } = header;
    let event = match kind {
        REQUEST => {
            let (header, payload) =
                body.split_at_checked(size_of::<RequestHeader>()).ok_or(UNKNOWN)?;
            let header: Box<RequestHeader> = Box::new(bytemuck::pod_read_unaligned(header));
            let last = last_of(lasts, session, &header).filter(|last| last.len() == payload.len());
            if payload.len() > MOST_PAYLOAD_BYTES || flags == DIFFERENCE && last.is_none() {
                return Err(UNKNOWN);
            }
            let last = last.filter(|_| flags == DIFFERENCE).unwrap_or_default();
            let payload = difference(&of_planes(payload), last);
            parsed(&header, payload.len())
                .map_err(|_| Damage("a record holds a request that is not valid"))?;
            keep(lasts, session, &header, &payload);
            Event::Request { session, number, header, payload }
        }
        ANSWER => {
            let answered: Answered = bytemuck::try_pod_read_unaligned(body).map_err(|_| UNKNOWN)?;
            Event::Answer { number, answered }
        }
        SESSION_ENDED => {
            let why = SessionEnd::ALL.into_iter().find(|why| *why as u32 == flags);
            Event::SessionEnded { session, why: why.ok_or(UNKNOWN)? }
        }
        WORKER_BEGAN => Event::WorkerBegan,
        _ => return Err(UNKNOWN),
    };
    Ok(Record { at_ns, event })
}

/// Bytes XOR others, as far as there are others. Done twice, it is the bytes again.
fn difference(bytes: &[u8], others: &[u8]) -> Vec<u8> {
    let mut difference = bytes.to_vec();
    difference.iter_mut().zip(others).for_each(|(byte, other)| *byte ^= other);
    difference
}

/// Bytes of a word.
const WORD: usize = 4;

/// The first bytes of all words, then the second ones, and so on.
fn to_planes(bytes: &[u8]) -> Vec<u8> {
    let mut planes = Vec::with_capacity(bytes.len());
    (0..WORD).for_each(|plane| planes.extend(bytes.iter().skip(plane).step_by(WORD)));
    planes
}

fn of_planes(planes: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; planes.len()];
    let mut from = planes.iter();
    for plane in 0..WORD {
        let to = bytes.iter_mut().skip(plane).step_by(WORD);
        // `to` first: what it has no more of is not taken from the planes.
        to.zip(&mut from).for_each(|(to, from)| *to = *from);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_and_differences_are_undone() {
        for len in 0..40u8 {
            let bytes: Vec<u8> = (0..len).map(|i| i.wrapping_mul(37)).collect();
            let others: Vec<u8> = (0..len / 2).map(|i| i.wrapping_mul(91)).collect();
            assert_eq!(of_planes(&to_planes(&bytes)), bytes);
            assert_eq!(difference(&difference(&bytes, &others), &others), bytes);
        }
        assert_eq!(to_planes(&[1, 2, 3, 4, 5, 6]), [1, 5, 2, 6, 3, 4]);
    }
}
