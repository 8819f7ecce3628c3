//! The forms by name. The names are part of the command line's contract.

/// A way to write the pairs of a sparse mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Form {
    /// Row, block, bits: 12 bytes a word, as on the wire.
    Sparse,
    /// First word of each row, 4 bytes; block, bits: 8 bytes a word.
    Prefix,
    /// Row, block of 64 columns, 64 bits: 16 bytes a word, and fewer words.
    Words64,
    /// Low half of the row, distance of the block from the row's own, bits: 8 bytes a word; first
    /// word of each 65,536 rows, 4 bytes.
    Packed,
    /// Two boxes: 8 bytes a pair. It needs no order.
    List,
}

impl Form {
    /// Every form, the wire's first.
    pub const ALL: [Self; 5] =
        [Self::Sparse, Self::Prefix, Self::Words64, Self::Packed, Self::List];

    /// The name in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Sparse => "sparse",
            Self::Prefix => "prefix",
            Self::Words64 => "words-64",
            Self::Packed => "packed",
            Self::List => "list",
        }
    }

    /// Whether its numbers are positions, so that a client needs the order to name boxes.
    pub const fn has_positions(self) -> bool {
        !matches!(self, Self::List)
    }
}
