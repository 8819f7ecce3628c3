//! Parsing of whole numbers for the command line and the configuration file.

use std::num::{IntErrorKind, ParseIntError};
use std::str::FromStr;

/// Parses an unsigned whole number; the error says what it must be.
pub fn whole_number<T: FromStr<Err = ParseIntError>>(text: &str) -> Result<T, String> {
    let is_negative = || {
        let digits = text.strip_prefix('-').unwrap_or_default();
        !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
    };
    text.parse().map_err(|error: ParseIntError| match error.kind() {
        IntErrorKind::PosOverflow => {
            format!("must be at most {}", u64::MAX >> (u64::BITS - 8 * size_of::<T>() as u32))
        }
        IntErrorKind::InvalidDigit | IntErrorKind::Empty if !is_negative() => {
            "must be a whole number in digits alone, such as 1000".to_owned()
        }
        // One that is never zero does not take that.
        _ => format!("must be at least {}", u8::from("0".parse::<T>().is_err())),
    })
}
