//! Sizes of memory, for the command line and the configuration file.

use std::str::FromStr;

use crate::serve::LEAST_MEMORY;

/// Units, each 1,024 times the one before: as Docker, Kubernetes (`Mi`) and systemd read them.
const UNITS: [char; 5] = ['B', 'K', 'M', 'G', 'T'];

/// A number of bytes: `512M`, `2G`, `1536MiB`, or the bytes alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemorySize(pub u64);

/// As [`MemorySize`], of a file, which may be of any size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileSize(pub u64);

impl FromStr for MemorySize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match bytes_of(text)? {
            bytes if bytes < LEAST_MEMORY => {
                Err(format!("must be at least {}M", LEAST_MEMORY >> 20))
            }
            bytes => Ok(Self(bytes)),
        }
    }
}

impl FromStr for FileSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        bytes_of(text).map(Self)
    }
}

fn bytes_of(text: &str) -> Result<u64, String> {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (digits, unit) = text.split_at(end);
    let unit = unit.to_ascii_uppercase();
    let unit = unit.strip_suffix("IB").or_else(|| unit.strip_suffix('I')).unwrap_or(&unit);
    let power = match unit {
        "" => Some(0),
        _ => UNITS.iter().position(|name| unit == name.to_string()),
    };
    let number = digits.parse::<u64>();
    let (Ok(number), Some(power)) = (number, power) else {
        return Err("must be a size such as 512M or 2G".to_owned());
    };
    number.checked_mul(1 << (10 * power)).ok_or_else(|| "is more than any machine has".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units_as_other_programs_read_them() {
        let bytes = |text: &str| text.parse::<MemorySize>().map(|size| size.0).ok();
        for text in ["512M", "512m", "512Mi", "512MiB", "524288K", "536870912", "536870912B"] {
            assert_eq!(bytes(text), Some(512 << 20), "{text}");
        }
        assert_eq!(
            (bytes("2G"), bytes("1T"), bytes("64M")),
            (Some(2 << 30), Some(1 << 40), Some(64 << 20))
        );
        for text in ["", "M", "63M", "-1G", "1.5G", "12X", "12MM", "99999999999G", "1 G", "é"] {
            assert_eq!(bytes(text), None, "{text}");
        }
    }
}
