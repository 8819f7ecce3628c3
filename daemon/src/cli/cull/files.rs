//! Pairs and masks as files of little-endian u32.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use pairmask::PairMask;
use pairmask_core::mask::{MaskView, WordAddress};
use rayon::slice::ParallelSliceMut;

use crate::cli::output::{OutputError, is_stdout};
use crate::file_error::{Access, FileError};

/// Why a result file was not written.
#[derive(Debug, thiserror::Error)]
pub enum ResultError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Too many pairs to sort.
    #[error("no memory to sort {pairs} pairs: write the mask instead (--mask)")]
    TooManyPairs { pairs: u64 },
}

/// Writes the pairs, the lower index first, in ascending order; to stdout for `-`.
///
/// # Errors
/// [`ResultError`].
pub fn write_pairs(path: &Path, mask: &PairMask) -> Result<(), ResultError> {
    let too_many = ResultError::TooManyPairs { pairs: mask.count() };
    let mut pairs: Vec<[u32; 2]> = Vec::new();
    let room = usize::try_from(mask.count()).ok();
    if room.is_none_or(|room| pairs.try_reserve_exact(room).is_err()) {
        return Err(too_many);
    }
    mask.view().for_each(|a, b| pairs.push([a, b]));
    if !pairs.is_sorted() {
        pairs.par_sort_unstable();
    }
    write_file(path, |file| file.write_all(bytemuck::cast_slice(&pairs)))
}

/// Writes the words of a dense mask; of a sparse one the order of the boxes, then the rows, the
/// blocks and the bits of its words. The order comes first and is always written, so that the
/// number of words follows from the file's length; of a list its pairs, in its own order. Of any
/// other mask the sections, as they lie in the reply. To stdout for `-`.
///
/// # Errors
/// [`ResultError`].
pub fn write_mask(path: &Path, mask: &PairMask) -> Result<(), ResultError> {
    let view = mask.view();
    write_file(path, |file| match &view {
        MaskView::Dense(dense) => file.write_all(bytemuck::cast_slice(dense.as_words())),
        MaskView::Sparse(sparse) => {
            let addresses = || {
                view.words().filter_map(|word| match word.address {
                    WordAddress::Sparse { row, block } => Some((row, block)),
                    WordAddress::Dense { .. } => None,
                })
            };
            match sparse.order() {
                Some(order) => write_words(file, order.iter().copied())?,
                None => write_words(file, 0..sparse.n().get())?,
            }
            write_words(file, addresses().map(|(row, _)| row))?;
            write_words(file, addresses().map(|(_, block)| block))?;
            write_words(file, view.words().map(|word| word.bits.0))
        }
        MaskView::List(_) => {
            let mut done = Ok(());
            view.for_each_slice(|pairs| {
                if done.is_ok() {
                    done = file.write_all(bytemuck::cast_slice(pairs));
                }
            });
            done
        }
        _ => {
            let sections = mask.shape().spans().filter_map(|span| span.of(mask.reply_words()));
            write_words(file, sections.flatten().copied())
        }
    })
}

fn write_words(file: &mut dyn Write, words: impl Iterator<Item = u32>) -> io::Result<()> {
    for word in words {
        file.write_all(&word.to_le_bytes())?;
    }
    Ok(())
}

fn write_file(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), ResultError> {
    let whole = |mut file: BufWriter<&mut dyn Write>| write(&mut file).and_then(|()| file.flush());
    if is_stdout(path) {
        return Ok(whole(BufWriter::new(&mut std::io::stdout().lock())).map_err(OutputError::Io)?);
    }
    let written = File::create(path).and_then(|mut file| whole(BufWriter::new(&mut file)));
    Ok(written.map_err(FileError::of(path, Access::Write))?)
}
