//! Parsing of whole numbers for the command line and the configuration file.

use std::num::{IntErrorKind, NonZeroU16, NonZeroU32, NonZeroU64, NonZeroUsize, ParseIntError};
use std::str::FromStr;

/// A type of whole numbers.
pub trait WholeNumber: FromStr<Err = ParseIntError> {
    /// The smallest.
    const LEAST: u64;
    /// The largest.
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

/// Parses a whole number.
///
/// # Errors
/// What it must be.
pub fn whole_number<T: WholeNumber>(text: &str) -> Result<T, String> {
    let is_negative = || {
        let digits = text.strip_prefix('-').unwrap_or_default();
        !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
    };
    text.parse().map_err(|error: ParseIntError| match error.kind() {
        IntErrorKind::PosOverflow => format!("must be at most {}", T::MOST),
        IntErrorKind::Zero | IntErrorKind::NegOverflow => format!("must be at least {}", T::LEAST),
        _ if is_negative() => format!("must be at least {}", T::LEAST),
        _ => "must be a whole number in digits alone, such as 1000".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrong<T>(what: &str) -> Result<T, String> {
        Err(format!("must be {what}"))
    }

    #[test]
    fn a_wrong_number_is_told_what_it_must_be() {
        assert_eq!(whole_number::<u32>("7"), Ok(7));
        assert_eq!(whole_number::<NonZeroUsize>("0").map(NonZeroUsize::get), wrong("at least 1"));
        assert_eq!(whole_number::<NonZeroU64>("-1").map(NonZeroU64::get), wrong("at least 1"));
        assert_eq!(whole_number::<u32>("-1"), wrong("at least 0"));
        assert_eq!(whole_number::<u32>("5000000000"), wrong("at most 4294967295"));
        assert_eq!(
            whole_number::<NonZeroU16>("70000").map(NonZeroU16::get),
            wrong("at most 65535")
        );
        let no_number = "a whole number in digits alone, such as 1000";
        for text in ["", "x", "1e6", "1.5", "-", "10k", "1_000", "--2"] {
            assert_eq!(whole_number::<u64>(text), wrong(no_number), "{text}");
        }
    }
}
