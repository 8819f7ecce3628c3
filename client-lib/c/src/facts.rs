//! Facts about an answered frame beside its pairs.

use std::ffi::c_char;

use bytemuck::{Pod, Zeroable};
use pairmask::PairMask;
use pairmask_core::engine::EngineId;
use pairmask_core::mask::{AddressedWord, Encoding, WordAddress};

use crate::session::{pm_served_by, served_by_number};

/// How a mask is written: one of `PM_ENCODING_...`.
pub type pm_encoding = u32;
/// A bit for every pair of boxes.
pub const PM_ENCODING_DENSE: pm_encoding = 0;
/// The words that are not zero, and where they belong.
pub const PM_ENCODING_SPARSE: pm_encoding = 1;
/// The pairs.
pub const PM_ENCODING_LIST: pm_encoding = 2;

/// A name in a struct: a text that ends with a zero.
pub type pm_name = [c_char; 24];

/// Facts about an answered frame beside its pairs.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_frame_info {
    /// `sizeof(pm_frame_info)`, set by the caller.
    pub struct_size: usize,
    /// What answered.
    pub served_by: pm_served_by,
    /// How the mask is written.
    pub encoding: pm_encoding,
    /// Boxes or spheres of the frame.
    pub n: u32,
    /// Threads that the engine could use.
    pub threads: u32,
    /// Boxes with `min > max` on some axis.
    pub empty: u32,
    /// Boxes with a NaN.
    pub invalid: u32,
    /// 1 where the frame was equal to the last one, so that no engine looked at it; else 0.
    pub is_repeat: u32,
    /// Zero.
    pub reserved: u32,
    /// Pairs that were never compared, of n(n - 1)/2.
    pub skipped_pairs: u64,
    /// Bytes of the mask.
    pub mask_bytes: u64,
    /// Bytes of the boxes or spheres as they were sent.
    pub box_bytes: u64,
    /// Time from the request in hand to the answer ready to be sent, ns.
    pub total_ns: u64,
    /// Of that: the pairs tested.
    pub execute_ns: u64,
    /// Name of the engine.
    pub engine: pm_name,
}

impl pm_frame_info {
    /// The facts of a mask.
    pub fn of(mask: &PairMask) -> Self {
        let info = mask.info();
        Self {
            struct_size: size_of::<Self>(),
            served_by: served_by_number(info.served_by),
            encoding: match mask.encoding() {
                Encoding::Dense => PM_ENCODING_DENSE,
                Encoding::Sparse => PM_ENCODING_SPARSE,
                // A later encoding would be decoded to pairs as well.
                _ => PM_ENCODING_LIST,
            },
            n: mask.n().get(),
            threads: u32::try_from(info.threads).unwrap_or(u32::MAX),
            empty: info.census.empty,
            invalid: info.census.invalid,
            is_repeat: u32::from(info.skipped.is_repeat()),
            reserved: 0,
            skipped_pairs: info.skipped.pairs,
            mask_bytes: info.mask_bytes,
            box_bytes: info.box_bytes,
            total_ns: info.times.total_ns,
            execute_ns: info.times.execute_ns,
            engine: name_of(info.engine),
        }
    }
}

/// The name of an engine, cut where there is no room for all of it.
#[allow(clippy::cast_possible_wrap)] // A `char` of C may have a sign.
pub fn name_of(engine: EngineId) -> pm_name {
    let mut name = pm_name::default();
    let text = engine.to_string();
    let room = name.len() - 1;
    for (slot, byte) in name[..room].iter_mut().zip(text.bytes()) {
        *slot = byte as c_char;
    }
    name
}

/// A word of a mask that is not zero. Bit t of `bits`, where it is set, names a pair: in a dense mask, pair
/// `first + t` in the order (0, 1), (0, 2), (0, 3) and so on, row by row: of n boxes, a < b is pair
/// a(2n - a - 1)/2 + b - a - 1. In a sparse mask, positions `row` and `32 * block + t` of `pm_mask_order`; in a
/// list, boxes `row` and `32 * block + t`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_word {
    /// Of a dense mask: number of the first pair.
    pub first: u64,
    /// Of a sparse mask: position of the row. Of a list: the lower index.
    pub row: u32,
    /// Of a sparse mask or a list: block of 32 columns.
    pub block: u32,
    /// A bit a pair.
    pub bits: u32,
    /// Zero.
    pub reserved: u32,
}

impl From<AddressedWord> for pm_word {
    fn from(word: AddressedWord) -> Self {
        let bits = word.bits.0;
        match word.address {
            WordAddress::Dense { first } => Self { first: first.get(), bits, ..Self::default() },
            WordAddress::Sparse { row, block } => Self { row, block, bits, ..Self::default() },
        }
    }
}
