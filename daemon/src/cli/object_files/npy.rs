//! numpy's .npy files, formats 1.0 and 2.0: a header in text, then the numbers of an array.
//!
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>

use std::io::{self, ErrorKind, Read, Write};

use super::{FileObject, quoted};

const MAGIC: &[u8] = b"\x93NUMPY";
/// Bytes of a header's text at most. numpy writes 118 for a plain array; format 1.0 has room for 65,535.
const LONGEST_HEADER: usize = 65_535;
/// numpy begins the numbers at a multiple of this.
const ALIGNMENT: usize = 64;

#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    #[error("{0}")]
    Read(io::Error),
    #[error("it is no .npy file: it does not begin as numpy's do")]
    Magic,
    #[error("it has .npy format {0}.{1}, of which 1.0 and 2.0 are read: save it by numpy.save")]
    Version(u8, u8),
    #[error("its .npy header is not as numpy writes it: '{0}'")]
    Header(String),
    #[error("its numbers are '{0}', of which '<f4' and '<f8' are read: save array.astype('<f4')")]
    Number(String),
    #[error("its numbers lie column by column: save numpy.ascontiguousarray(array)")]
    Columns,
    #[error("its shape is {found}, where (n, {}) is read: {}", columns.len(), columns.join(" "))]
    Shape { found: String, columns: &'static [&'static str] },
    #[error("its header says {said} rows, and {found} are there: is it truncated?")]
    Rows { said: u64, found: u64 },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Number {
    F32,
    F64,
}

#[derive(Debug, PartialEq, Eq)]
pub struct Header {
    pub number: Number,
    shape: Vec<u64>,
}

impl Header {
    /// Reads a header, up to the first number.
    pub fn read(file: &mut impl Read) -> Result<Self, NpyError> {
        let short = |error: io::Error| match error.kind() {
            ErrorKind::UnexpectedEof => NpyError::Magic,
            _ => NpyError::Read(error),
        };
        let mut start = [0; MAGIC.len() + 2];
        file.read_exact(&mut start).map_err(short)?;
        let [magic @ .., major, minor] = &start;
        if magic != MAGIC {
            return Err(NpyError::Magic);
        }
        let mut len = [0; 4];
        let len_bytes = match (major, minor) {
            (1, 0) => 2,
            (2, 0) => 4,
            _ => return Err(NpyError::Version(*major, *minor)),
        };
        file.read_exact(&mut len[..len_bytes]).map_err(short)?;
        let len = u32::from_le_bytes(len) as usize;
        if len > LONGEST_HEADER {
            return Err(NpyError::Header(format!("{len} bytes")));
        }
        let mut text = vec![0; len];
        file.read_exact(&mut text).map_err(short)?;
        Self::parse(&String::from_utf8_lossy(&text))
    }

    fn parse(text: &str) -> Result<Self, NpyError> {
        let unreadable = || NpyError::Header(quoted(text));
        let entries = Dictionary::parse(text).ok_or_else(unreadable)?;
        let number = match entries.descr {
            "<f4" => Number::F32,
            "<f8" => Number::F64,
            other => return Err(NpyError::Number(quoted(other))),
        };
        // Rows and columns are the same where there is one of either, which no box or sphere has of its columns.
        let has_rows = entries.shape.first().is_some_and(|rows| *rows > 1);
        if entries.fortran_order && has_rows {
            return Err(NpyError::Columns);
        }
        Ok(Self { number, shape: entries.shape })
    }

    /// How many rows of these columns there are.
    pub fn rows(&self, columns: &'static [&'static str]) -> Result<u64, NpyError> {
        match self.shape[..] {
            [rows, width] if width == columns.len() as u64 => Ok(rows),
            _ => {
                let lengths: Vec<_> = self.shape.iter().map(ToString::to_string).collect();
                Err(NpyError::Shape { found: format!("({})", lengths.join(", ")), columns })
            }
        }
    }
}

/// A dictionary of Python with the three keys of a header, each once, in any order.
struct Dictionary<'a> {
    descr: &'a str,
    fortran_order: bool,
    shape: Vec<u64>,
}

impl<'a> Dictionary<'a> {
    fn parse(text: &'a str) -> Option<Self> {
        let mut rest = text.trim().strip_prefix('{')?;
        let (mut descr, mut fortran_order, mut shape) = (None, None, None);
        loop {
            rest = rest.trim_start();
            if let Some(end) = rest.strip_prefix('}') {
                let entries = (descr?, fortran_order?, shape?);
                let (descr, fortran_order, shape) = entries;
                return end.is_empty().then_some(Self { descr, fortran_order, shape });
            }
            let (key, value) = string(rest)?;
            let value = value.trim_start().strip_prefix(':')?.trim_start();
            let is_first = match key {
                "descr" => take(&mut rest, &mut descr, string(value)?),
                "fortran_order" => take(&mut rest, &mut fortran_order, truth(value)?),
                "shape" => take(&mut rest, &mut shape, tuple(value)?),
                _ => false,
            };
            if !is_first {
                return None;
            }
            let end = rest.trim_start();
            rest = match end.strip_prefix(',') {
                Some(more) => more,
                None if end.starts_with('}') => end,
                None => return None,
            };
        }
    }
}

/// Keeps a value and goes on behind it; false where there was one.
fn take<'a, T>(rest: &mut &'a str, slot: &mut Option<T>, (value, behind): (T, &'a str)) -> bool {
    *rest = behind;
    slot.replace(value).is_none()
}

fn string(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| ['\'', '"'].contains(c))?;
    text[1..].split_once(quote)
}

fn truth(text: &str) -> Option<(bool, &str)> {
    let [is_true, is_false] = ["True", "False"].map(|word| text.strip_prefix(word));
    is_true.map(|rest| (true, rest)).or_else(|| is_false.map(|rest| (false, rest)))
}

fn tuple(text: &str) -> Option<(Vec<u64>, &str)> {
    let (inner, rest) = text.strip_prefix('(')?.split_once(')')?;
    let inner = inner.trim();
    let inner = inner.strip_suffix(',').unwrap_or(inner);
    let numbers = inner.split(',').map(|number| number.trim().parse().ok());
    let numbers: Option<Vec<u64>> =
        if inner.is_empty() { Some(Vec::new()) } else { numbers.collect() };
    Some((numbers?, rest))
}

/// Reads f64, each object rounded outward. The header's number of rows is not trusted with memory.
pub fn read_f64<T: FileObject>(file: &mut impl Read, rows: u64) -> Result<Vec<T>, NpyError> {
    let width = T::COLUMNS.len();
    let (mut bytes, mut numbers) = (vec![0; 8 * width], vec![0.0; width]);
    let mut objects = Vec::new();
    loop {
        let read = read_full(file, &mut bytes).map_err(NpyError::Read)?;
        let found = objects.len() as u64;
        match (read, found == rows) {
            (0, true) => return Ok(objects),
            (_, true) => return Err(NpyError::Rows { said: rows, found: found + 1 }),
            (read, false) if read < bytes.len() => {
                return Err(NpyError::Rows { said: rows, found });
            }
            _ => {}
        }
        for (number, bytes) in numbers.iter_mut().zip(bytes.as_chunks().0) {
            *number = f64::from_le_bytes(*bytes);
        }
        objects.push(T::outward(&numbers));
    }
}

/// Fills `bytes` as far as the file goes.
fn read_full(file: &mut impl Read, bytes: &mut [u8]) -> io::Result<usize> {
    let mut read = 0;
    while read < bytes.len() {
        match file.read(&mut bytes[read..]) {
            Ok(0) => break,
            Ok(more) => read += more,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(read)
}

/// Writes the header of an array of `rows` and `columns`.
pub fn write_header(
    file: &mut dyn Write,
    descr: &str,
    rows: usize,
    columns: usize,
) -> io::Result<()> {
    let text =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    // Magic, version and length before the text, and a line's end behind it.
    let before = MAGIC.len() + 2 + 2;
    let whole = (before + text.len() + 1).next_multiple_of(ALIGNMENT);
    let len = u16::try_from(whole - before).map_err(|_| ErrorKind::InvalidInput)?;
    file.write_all(MAGIC)?;
    file.write_all(&[1, 0])?;
    file.write_all(&len.to_le_bytes())?;
    writeln!(file, "{text:<width$}", width = usize::from(len) - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_read_as_numpy_writes_them_and_nothing_else() {
        let parse = |text: &str| Header::parse(text).map_err(|error| error.to_string());
        let header = |number, shape: &[u64]| Ok(Header { number, shape: shape.to_vec() });
        for (text, expected) in [
            (
                "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 6), }   \n",
                header(Number::F32, &[3, 6]),
            ),
            (
                "{\"shape\":(1,6),\"fortran_order\":True,\"descr\":\"<f8\"}",
                header(Number::F64, &[1, 6]),
            ),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (7,)}", header(Number::F32, &[7])),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': ()}", header(Number::F32, &[])),
        ] {
            assert_eq!(parse(text), expected, "{text}");
        }
        for (text, part) in [
            ("", "''"),
            ("{", "'{'"),
            ("{}", "'{}'"),
            ("{'descr': '<f4', 'fortran_order': False}", "not as numpy"),
            ("{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': ()}", "not as"),
            ("{'descr': '<f4' 'fortran_order': False, 'shape': ()}", "not as numpy"),
            ("{'descr': '<f4', 'fortran_order': 0, 'shape': ()}", "not as numpy"),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 6)}", "not as numpy"),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 6), 'x': 1}", "not as numpy"),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 6)} x", "not as numpy"),
            ("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (3,)}", "not as numpy"),
            ("{'descr': '>f4', 'fortran_order': False, 'shape': (3, 6)}", "'>f4'"),
            ("{'descr': '<f4', 'fortran_order': True, 'shape': (3, 6)}", "ascontiguousarray"),
        ] {
            let error = parse(text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn a_header_that_is_written_is_read_and_the_numbers_are_aligned() {
        for rows in [0, 1, 345, usize::MAX] {
            let mut file = Vec::new();
            write_header(&mut file, "<f4", rows, 6).expect("memory");
            assert!(file.len().is_multiple_of(ALIGNMENT) && file.ends_with(b"\n"));
            let mut rest = file.as_slice();
            let header = Header::read(&mut rest).expect("a header");
            assert_eq!(header, Header { number: Number::F32, shape: vec![rows as u64, 6] });
            assert!(rest.is_empty());
        }
    }
}
