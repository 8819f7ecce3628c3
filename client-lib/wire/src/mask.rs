//! Masks as sections of a payload.

use pairmask_core::mask::{Encoding, MaskShape};
use pairmask_core::units::BoxCount;

use crate::section::{SECTION_COUNT, Section, SectionKind, find, has, slots};

pub(crate) fn mask_sections(shape: &MaskShape) -> [Section; SECTION_COUNT] {
    use SectionKind::{DenseWords, ListPairs, Order, SparseBits, SparseBlocks, SparseRows};
    let section = |(kind, span)| Section::of_words(kind, span);
    match *shape {
        MaskShape::Dense { words } => slots([section((DenseWords, words))]),
        MaskShape::Sparse { rows, blocks, bits, order } => {
            let words = [(SparseRows, rows), (SparseBlocks, blocks), (SparseBits, bits)];
            let order = order.map(|order| (Order, order));
            slots(words.into_iter().chain(order).map(section))
        }
        MaskShape::List { pairs } => slots([section((ListPairs, pairs))]),
        // An encoding of the core that the wire contract does not have: readers find no mask.
        _ => slots([]),
    }
}

/// Where the mask of `n` boxes lies in a payload, by sections that another process has written.
///
/// # Errors
/// The name of what is malformed.
pub(crate) fn mask_shape(
    encoding: Encoding,
    sections: &[Section; SECTION_COUNT],
    n: BoxCount,
    payload_bytes: u64,
) -> Result<MaskShape, &'static str> {
    let span = |kind, field| {
        let section = find(sections, kind, 4, payload_bytes);
        section.map(|section| section.span()).ok_or(field)
    };
    let check = |is_right, field| if is_right { Ok(()) } else { Err(field) };
    match encoding {
        Encoding::Dense => {
            let words = span(SectionKind::DenseWords, "dense words")?;
            check(words.len == n.dense_words(), "dense words")?;
            Ok(MaskShape::Dense { words })
        }
        Encoding::Sparse => {
            let rows = span(SectionKind::SparseRows, "sparse rows")?;
            let blocks = span(SectionKind::SparseBlocks, "sparse blocks")?;
            let bits = span(SectionKind::SparseBits, "sparse bits")?;
            check(rows.len == blocks.len && rows.len == bits.len, "sparse word count")?;
            let has_order = has(sections, SectionKind::Order);
            let order = has_order.then(|| span(SectionKind::Order, "order")).transpose()?;
            check(order.is_none_or(|order| order.len == u64::from(n.get())), "order")?;
            Ok(MaskShape::Sparse { rows, blocks, bits, order })
        }
        Encoding::List => {
            let pairs = span(SectionKind::ListPairs, "list pairs")?;
            check(pairs.len.is_multiple_of(2), "list pairs")?;
            Ok(MaskShape::List { pairs })
        }
        // One of a later core.
        _ => Err("encoding"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::find_unknown;

    #[test]
    fn every_encoding_has_sections_that_are_read_as_they_were_written() {
        let n = BoxCount::new(100);
        for encoding in Encoding::ALL {
            for with_order in [false, true] {
                let shape = MaskShape::exact(encoding, n, 7, with_order);
                let sections = mask_sections(&shape);
                assert_eq!(find_unknown(&sections), None);
                let payload_bytes = 4 * shape.extent_words();
                assert_eq!(mask_shape(encoding, &sections, n, payload_bytes), Ok(shape));
                let short = mask_shape(encoding, &sections, n, payload_bytes - 4);
                assert!(short.is_err(), "{encoding}");
            }
        }
    }
}
