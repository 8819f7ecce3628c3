//! The formats of files of boxes, spheres and pairs.

use std::path::Path;

use clap::ValueEnum;

/// How numbers lie in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// Little-endian f32 or u32, nothing before, between or after them
    Raw,
    /// A line each, with spaces between the numbers; lines that begin with # are comments
    Text,
    /// A line each, with commas between the numbers, and a line of names before them or none
    Csv,
    /// An array of numpy: f4 or f8 of shape (n, 6) or (n, 4); pairs are u4 of shape (n, 2)
    Npy,
}

impl Format {
    /// The format that the end of a file's name stands for: .txt, .csv, .npy. Others are raw, stdin and stdout too.
    pub fn of(path: &Path) -> Self {
        let end = path.extension().and_then(std::ffi::OsStr::to_str).unwrap_or_default();
        match end.to_ascii_lowercase().as_str() {
            "txt" => Self::Text,
            "csv" => Self::Csv,
            "npy" => Self::Npy,
            _ => Self::Raw,
        }
    }

    pub const fn is_binary(self) -> bool {
        matches!(self, Self::Raw | Self::Npy)
    }
}
