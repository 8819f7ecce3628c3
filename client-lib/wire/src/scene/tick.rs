//! What an answered commit of a shared scene says beside its pairs: the tick, who was late, and user data.

use std::ops::Range;

use pairmask_core::mask::Span;
use pairmask_core::scene::UserData;

use super::answer::SceneAnswerLayout;
use crate::reply::{ReplyError, ResponseHeader};
use crate::section::{Section, SectionKind, find, has};

/// What an answered commit says beside its pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickMarks {
    /// The tick that the commit was part of, from 1.
    pub tick: u64,
    /// Where ranges of writers lie that had not committed, two words each.
    pub late: Span,
    /// Where user data lie that have changed since the member's last answer, three words each.
    pub user_data: Span,
}

/// What a tick has beside what a scene reports.
#[derive(Clone, Copy, Debug)]
pub struct TickNotes<'a> {
    /// The tick that the commit was part of, from 1.
    pub tick: u64,
    /// Leases of writers that had not committed.
    pub late: &'a [Range<u32>],
    /// Indices, and their user data, that have changed since the member's last answer.
    pub user_data: &'a [(u32, u64)],
}

/// Words of an index and its user data.
const MARKED_WORDS: u64 = 3;

impl TickMarks {
    /// Of a tick whose notes follow what a scene reports.
    pub fn after(scene: &SceneAnswerLayout, notes: &TickNotes<'_>) -> Self {
        let late = Span { start: scene.words(), len: 2 * notes.late.len() as u64 };
        let start = late.start + late.len;
        let user_data = Span { start, len: MARKED_WORDS * notes.user_data.len() as u64 };
        Self { tick: notes.tick, late, user_data }
    }

    /// Words of the payload.
    pub const fn words(&self) -> u64 {
        self.user_data.start + self.user_data.len
    }

    /// Writes the notes into at least so many words.
    ///
    /// # Panics
    /// With fewer.
    pub fn write(&self, notes: &TickNotes<'_>, words: &mut [u32]) {
        let to = &mut words[self.late.start as usize..self.words() as usize];
        let (late, user_data) = to.split_at_mut(self.late.len as usize);
        let late = late.as_chunks_mut::<2>().0;
        late.iter_mut().zip(notes.late).for_each(|(to, range)| *to = [range.start, range.end]);
        let user_data = user_data.as_chunks_mut::<3>().0;
        user_data.iter_mut().zip(notes.user_data).for_each(|(to, (index, user_data))| {
            let [low, high] = bytemuck::cast(UserData::from(*user_data));
            *to = [*index, low, high];
        });
    }

    /// Adds the marks to the header of what a scene reports.
    #[must_use]
    pub fn mark(&self, header: ResponseHeader) -> ResponseHeader {
        let mut header = header;
        header.detail[1] = self.tick;
        header.sections[4] = Section::of_words(SectionKind::LateRanges, self.late);
        if self.user_data.len > 0 {
            // Clients of before 1.13 do not know it, and need not.
            let section = Section::of_words(SectionKind::UserData, self.user_data);
            header.sections[5] = Section { flags: 0, ..section };
        }
        header
    }

    /// Checks the header of an answer that was parsed as that of a scene.
    ///
    /// # Errors
    /// [`ReplyError`] with the first field that is wrong.
    pub fn parse(header: &ResponseHeader, payload_bytes: u64) -> Result<Self, ReplyError> {
        let late = find(&header.sections, SectionKind::LateRanges, 8, payload_bytes);
        let late = late.ok_or(ReplyError::Malformed { field: "late ranges" })?;
        let mut user_data = Span { start: late.span().start + late.span().len, len: 0 };
        if has(&header.sections, SectionKind::UserData) {
            let found =
                find(&header.sections, SectionKind::UserData, 4 * MARKED_WORDS, payload_bytes);
            user_data = found.ok_or(ReplyError::Malformed { field: "user data" })?.span();
        }
        Ok(Self { tick: header.detail[1], late: late.span(), user_data })
    }

    /// Indices and their user data. Another process may have written anything there.
    pub fn user_data_in<'a>(&self, words: &'a [u32]) -> impl Iterator<Item = (u32, u64)> + use<'a> {
        let Span { start, len } = self.user_data;
        let own = words.get(start as usize..).and_then(|words| words.get(..len as usize));
        let entries = own.unwrap_or_default().as_chunks::<3>().0;
        let of = |words: [u32; 2]| u64::from(bytemuck::cast::<_, UserData>(words));
        entries.iter().map(move |[index, low, high]| (*index, of([*low, *high])))
    }

    /// The late ranges. Another process may have written anything there: what is no range is passed over.
    pub fn late_in(&self, words: &[u32]) -> Vec<Range<u32>> {
        let pairs = SceneAnswerLayout::pairs_in(&self.late, words);
        // Each is read once: what is checked is what is given.
        let ranges = pairs.iter().copied().filter(|[first, end]| first < end);
        ranges.map(|[first, end]| first..end).collect()
    }
}
