//! Parsing of whole numbers for the command line and the configuration file.

use std::num::{IntErrorKind, NonZeroU16, NonZeroU32, NonZeroU64, NonZeroUsize, ParseIntError};
use std::str::FromStr;

pub trait WholeNumber: FromStr<Err = ParseIntError> {
    const LEAST: u64;
    const MOST: u64;
}

macro_rules! impl_whole_number {
    ($($kind:ty: $least:literal to $most:expr;)*) => {
        $(impl WholeNumber for $kind {
            const LEAST: u64 = $least;
            const MOST: u64 = $most as u64;
        })*
    };
}

impl_whole_number! {
    u32: 0 to u32::MAX;
    u64: 0 to u64::MAX;
    NonZeroU16: 1 to u16::MAX;
    NonZeroU32: 1 to u32::MAX;
    NonZeroU64: 1 to u64::MAX;
    NonZeroUsize: 1 to usize::MAX;
}

/// Parses a whole number; the error says what it must be.
pub fn whole_number<T: WholeNumber>(text: &str) -> Result<T, String> {
    let is_negative = || {
        let digits = text.strip_prefix('-').unwrap_or_default();
        !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
    };
    text.parse().map_err(|error: ParseIntError| match error.kind() {
        IntErrorKind::PosOverflow => format!("must be at most {}", T::MOST),
        IntErrorKind::InvalidDigit | IntErrorKind::Empty if !is_negative() => {
            "must be a whole number in digits alone, such as 1000".to_owned()
        }
        _ => format!("must be at least {}", T::LEAST),
    })
}
