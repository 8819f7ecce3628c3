//! Objects in text: a line each.
//!
//! A number becomes the nearest f32. Rounding keeps the order of numbers, so that no pair is lost.

use std::io::{self, BufRead, Read};

use super::{FileObject, Format, quoted};

/// Bytes of a line at most: six numbers of every digit that an f32 may have are below 1,000.
const LONGEST_LINE: u64 = 4096;

#[derive(Debug, thiserror::Error)]
pub enum TableError {
    #[error("{0}")]
    Read(io::Error),
    #[error("line {line}, column {column}: '{text}' is no number")]
    Number { line: u64, column: usize, text: String },
    #[error(
        "line {line}: there are {found} columns, where {} make one of the {plural}: {}",
        columns.len(), columns.join(" ")
    )]
    Columns { line: u64, found: usize, plural: &'static str, columns: &'static [&'static str] },
    #[error("line {line}: it is longer than {LONGEST_LINE} bytes: is it a file of text?")]
    Long { line: u64 },
}

/// Reads objects from text, or from CSV with a line of names or without.
pub fn read<T: FileObject>(file: &mut impl BufRead, format: Format) -> Result<Vec<T>, TableError> {
    let (mut objects, mut bytes) = (Vec::new(), Vec::new());
    let mut may_be_names = format == Format::Csv;
    for line in 1.. {
        bytes.clear();
        let read = file.by_ref().take(LONGEST_LINE + 1).read_until(b'\n', &mut bytes);
        if read.map_err(TableError::Read)? == 0 {
            break;
        }
        if bytes.len() as u64 > LONGEST_LINE {
            return Err(TableError::Long { line });
        }
        let text = String::from_utf8_lossy(&bytes);
        // Some programs mark text as UTF-8 by a character before it.
        let text = if line == 1 { text.trim_start_matches('\u{feff}') } else { &text }.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let fields: Vec<&str> = match format {
            Format::Csv => text.split(',').map(str::trim).collect(),
            _ => text.split_ascii_whitespace().collect(),
        };
        // A line of names has no number at all: a box with one that is misspelt is not taken for it.
        if std::mem::take(&mut may_be_names) && fields.iter().all(|text| number(text).is_none()) {
            continue;
        }
        objects.push(object(&fields, line)?);
    }
    Ok(objects)
}

fn number(text: &str) -> Option<f32> {
    text.parse().ok()
}

fn object<T: FileObject>(fields: &[&str], line: u64) -> Result<T, TableError> {
    let columns = T::COLUMNS;
    let mut object = T::default();
    let numbers: &mut [f32] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut object));
    for (column, (text, slot)) in fields.iter().zip(numbers).enumerate() {
        *slot = number(text).ok_or_else(|| TableError::Number {
            line,
            column: column + 1,
            text: quoted(text),
        })?;
    }
    if fields.len() != columns.len() {
        let (found, plural) = (fields.len(), T::PLURAL);
        return Err(TableError::Columns { line, found, plural, columns });
    }
    Ok(object)
}
