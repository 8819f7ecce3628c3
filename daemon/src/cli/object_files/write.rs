//! Writes objects and pairs in a [`Format`].

use std::fmt::Debug;
use std::io::{self, Write};

use bytemuck::Pod;

use super::{FileObject, Format, npy};

const PAIR: [&str; 2] = ["a", "b"];

pub fn write_objects<T: FileObject>(
    file: &mut dyn Write,
    format: Format,
    objects: &[T],
) -> io::Result<()> {
    let numbers: &[f32] = bytemuck::cast_slice(objects);
    write_rows(file, format, "<f4", T::COLUMNS, numbers)
}

pub fn write_pairs(file: &mut dyn Write, format: Format, pairs: &[[u32; 2]]) -> io::Result<()> {
    write_rows(file, format, "<u4", &PAIR, pairs.as_flattened())
}

/// Rows of as many numbers as there are columns.
fn write_rows<N: Pod + Debug>(
    file: &mut dyn Write,
    format: Format,
    descr: &str,
    columns: &[&str],
    numbers: &[N],
) -> io::Result<()> {
    let separator = match format {
        Format::Raw => return file.write_all(bytemuck::cast_slice(numbers)),
        Format::Npy => {
            npy::write_header(file, descr, numbers.len() / columns.len(), columns.len())?;
            return file.write_all(bytemuck::cast_slice(numbers));
        }
        Format::Text => ' ',
        Format::Csv => {
            writeln!(file, "{}", columns.join(","))?;
            ','
        }
    };
    for row in numbers.chunks(columns.len()) {
        for (column, number) in row.iter().enumerate() {
            if column > 0 {
                write!(file, "{separator}")?;
            }
            // The shortest digits that are read as the same number.
            write!(file, "{number:?}")?;
        }
        writeln!(file)?;
    }
    Ok(())
}
