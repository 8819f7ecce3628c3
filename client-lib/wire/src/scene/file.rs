//! A saved scene: an edit that makes it, behind a header. WIRE.md draws it.

use std::io::{self, Read, Write};

use bytemuck::{Pod, Zeroable};
use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::{Edit, Report, Step};

use super::body::{EditLayout, EditScratch, STEP_BYTES};
use super::request::{BOX_BYTES, SceneId, SceneRequest};
use crate::page::{PAGE_BYTES, Page, page_count};
use crate::reject::Reject;
use crate::section::{SECTION_COUNT, Section, SectionKind, find, find_unknown, slots};
use crate::{VERSION_MAJOR, VERSION_MINOR, Version};

/// "PMSC" in memory order. A wrong magic means that the file is no scene.
const SCENE_MAGIC: u32 = u32::from_le_bytes(*b"PMSC");
/// Pages that are read at a time, 1 MiB: a file that says it is larger than it is takes no more memory than that.
const PAGES_AT_A_TIME: u64 = 256;

/// Header of a file, 208 bytes.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct FileHeader {
    magic: u32,
    version_major: u16,
    version_minor: u16,
    /// Bytes that follow.
    payload_bytes: u64,
    sections: [Section; SECTION_COUNT],
}

const _: () = assert!(size_of::<FileHeader>() == 208);

/// Why a scene is not saved, or not read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneFileError {
    /// The reader or the writer has failed.
    #[error("reading or writing a scene: {0}")]
    Io(#[from] io::Error),
    /// It does not begin as a saved scene does.
    #[error("this is no scene that was saved")]
    NotAScene,
    /// A later version has saved it.
    #[error(
        "the scene was saved by version {0}, which this build does not know: install a newer pairmask"
    )]
    Version(Version),
    /// It ends too soon.
    #[error("the file of a scene is truncated")]
    Truncated,
    /// It says what cannot be.
    #[error("the scene's {0} is malformed")]
    Malformed(&'static str),
    /// More boxes or filters than a file may have, or no memory for them.
    #[error("there is no memory for a scene of {bytes} bytes")]
    OutOfMemory {
        /// Bytes of its file.
        bytes: u64,
    },
}

impl From<Reject> for SceneFileError {
    fn from(reject: Reject) -> Self {
        match reject {
            Reject::Edit(field) => Self::Malformed(field),
            _ => Self::Malformed("edit"),
        }
    }
}

fn pages_for(bytes: u64, out: &mut Vec<Page>) -> Result<(), SceneFileError> {
    let pages = usize::try_from(page_count(bytes)).unwrap_or(usize::MAX);
    let more = pages.saturating_sub(out.len());
    out.try_reserve_exact(more).map_err(|_| SceneFileError::OutOfMemory { bytes })?;
    out.resize(pages, Page::zeroed());
    Ok(())
}

/// Saves a scene: the edit that makes it.
///
/// # Errors
/// [`SceneFileError`].
pub fn write_scene(edit: Edit<'_>, to: &mut dyn Write) -> Result<(), SceneFileError> {
    let too_large = SceneFileError::OutOfMemory { bytes: u64::MAX };
    let layout = EditLayout::of(edit).ok_or(too_large)?;
    let payload_bytes = layout.payload_bytes();
    let mut pages = Vec::new();
    pages_for(payload_bytes, &mut pages)?;
    if !layout.write(edit, &mut pages) {
        return Err(SceneFileError::OutOfMemory { bytes: payload_bytes });
    }
    let header = FileHeader {
        magic: SCENE_MAGIC,
        version_major: VERSION_MAJOR,
        version_minor: VERSION_MINOR,
        payload_bytes,
        sections: slots(layout.sections()),
    };
    to.write_all(bytemuck::bytes_of(&header))?;
    let payload: &[u8] = bytemuck::cast_slice(&pages);
    to.write_all(&payload[..payload_bytes as usize])?;
    Ok(to.flush()?)
}

/// A saved scene that was read.
#[derive(Debug)]
pub struct SceneFile {
    edit: EditScratch,
}

impl SceneFile {
    /// Reads a scene, whose indices must be below `most_boxes`. Nothing behind it is read.
    ///
    /// # Errors
    /// [`SceneFileError`].
    pub fn read(from: &mut dyn Read, most_boxes: u32) -> Result<Self, SceneFileError> {
        let truncated = |error: io::Error| match error.kind() {
            io::ErrorKind::UnexpectedEof => SceneFileError::Truncated,
            _ => error.into(),
        };
        let mut header = FileHeader::zeroed();
        from.read_exact(bytemuck::bytes_of_mut(&mut header)).map_err(truncated)?;
        if header.magic != SCENE_MAGIC {
            return Err(SceneFileError::NotAScene);
        }
        let version = Version { major: header.version_major, minor: header.version_minor };
        if version.major != VERSION_MAJOR || find_unknown(&header.sections).is_some() {
            return Err(SceneFileError::Version(version));
        }
        let section = |kind, entry_bytes, field| {
            let section = find(&header.sections, kind, entry_bytes, header.payload_bytes);
            section.ok_or(SceneFileError::Malformed(field))
        };
        let request = SceneRequest {
            scene: SceneId(0),
            base: 0,
            revision: 1,
            is_acknowledged: false,
            is_lost: false,
            reported: None,
            report: Report::Nothing,
            most_boxes,
            engine: EngineChoice::Auto,
            threads: None,
            boxes: section(SectionKind::Boxes, BOX_BYTES, "boxes")?,
            steps: section(SectionKind::SceneSteps, STEP_BYTES, "steps")?,
            indices: section(SectionKind::SceneIndices, 4, "indices")?,
        };
        let (mut pages, mut read) = (Vec::new(), 0);
        while read < header.payload_bytes {
            let end = header.payload_bytes.min(read + PAGES_AT_A_TIME * PAGE_BYTES as u64);
            pages_for(end, &mut pages)?;
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut pages);
            from.read_exact(&mut bytes[read as usize..end as usize]).map_err(truncated)?;
            read = end;
        }
        let mut edit = EditScratch::default();
        edit.copy(&request, &pages)?;
        Ok(Self { edit })
    }

    /// The steps of an edit that makes the scene where there is no box.
    ///
    /// # Errors
    /// None, where it was read: it was checked then.
    pub fn steps(&self) -> Result<Vec<Step<'_>>, SceneFileError> {
        Ok(self.edit.steps()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pairmask_core::Aabb;
    use pairmask_core::filters::{Filter, FilterData, FilterTable, World};
    use pairmask_core::scene::{FilterDataSets, Indices, Sets};

    /// Saves what a scene may have.
    fn saved() -> Vec<u8> {
        let boxes: Vec<Aabb> = (0..300).map(|i| Aabb::point([i as f32; 3])).collect();
        let filter_data = [FilterData::default().with_world(World(3)); 2];
        let table = FilterTable::new(&[Filter::new(1, 2)]).expect("one");
        let steps = [
            Step::Set(Sets { indices: (0..300).into(), boxes: &boxes }),
            Step::Enable(Indices::List(&[4, 9, 200]), false),
            Step::Static((5..80).into(), true),
            Step::FilterData(FilterDataSets {
                indices: (&[7, 8]).into(),
                filter_data: &filter_data,
            }),
            Step::Filters(&table),
            Step::Include(&[[1, 2]], true),
            Step::Exclude(&[[3, 250], [3, 4]], true),
        ];
        let mut bytes = Vec::new();
        write_scene(Edit { steps: &steps }, &mut bytes).expect("written");
        bytes
    }

    /// Reads a scene, and saves what was read.
    fn read(mut bytes: &[u8]) -> Result<Vec<u8>, SceneFileError> {
        let file = SceneFile::read(&mut bytes, 300)?;
        let mut again = Vec::new();
        write_scene(Edit { steps: &file.steps()? }, &mut again)?;
        Ok(again)
    }

    #[test]
    fn what_is_saved_is_read_and_what_follows_is_left() {
        let bytes = saved();
        assert_eq!(bytes[..8], *b"PMSC\x01\x00\x0f\x00");
        assert_eq!(read(&bytes).expect("right"), bytes);
        let both = [bytes.clone(), b"more".to_vec()].concat();
        let mut rest = &both[..];
        SceneFile::read(&mut rest, 300).expect("right");
        assert_eq!(rest, b"more");
    }

    #[test]
    fn a_file_that_ends_anywhere_is_truncated() {
        let bytes = saved();
        for end in (0..bytes.len()).step_by(7).chain([207, 208, bytes.len() - 1]) {
            assert!(matches!(read(&bytes[..end]), Err(SceneFileError::Truncated)), "{end}");
        }
    }

    #[test]
    fn what_is_no_scene_of_this_version_is_refused() {
        let forged = |at: usize, to: u8| {
            let mut bytes = saved();
            bytes[at] = to;
            read(&bytes)
        };
        assert!(matches!(forged(0, b'p'), Err(SceneFileError::NotAScene)));
        let version = Version { major: 2, minor: VERSION_MINOR };
        assert!(matches!(forged(4, 2), Err(SceneFileError::Version(found)) if found == version));
        // A later minor version that says nothing new is read, and one with a section that is not known is not.
        assert!(forged(6, 99).is_ok());
        let sections = std::mem::offset_of!(FileHeader, sections);
        assert!(forged(sections + 3 * 24, 200).is_ok(), "a section that is not required");
        assert!(matches!(forged(sections + 2, 1), Err(SceneFileError::Version(_))));
    }

    #[test]
    fn a_length_that_is_a_lie_takes_little_memory() {
        let mut bytes = saved();
        bytes[8..16].copy_from_slice(&(1u64 << 60).to_le_bytes());
        assert!(matches!(read(&bytes), Err(SceneFileError::Truncated)));
    }

    #[test]
    fn no_change_of_a_byte_does_harm() {
        let right = saved();
        let mut refused = 0;
        for at in 0..right.len() {
            let mut bytes = right.clone();
            bytes[at] ^= 1 << (at % 8);
            refused += usize::from(read(&bytes).is_err());
        }
        assert!(refused > 20, "{refused}");
    }
}
