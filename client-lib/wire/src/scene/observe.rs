//! An observer's question: which boxes of a shared scene changed, regardless of who wrote them, and what they are now.

use bytemuck::{Pod, Zeroable};
use pairmask_core::aabb::Aabb;
use pairmask_core::filters::{Filter, FilterData, FilterTable};

use super::request::SceneId;
use crate::header::{Operation, RequestHeader};
use crate::page::Page;
use crate::reply::{Reply, ReplyError, ReplyFields, ResponseHeader, envelope};
use crate::rules::entries::{FILTER_WORDS, filter_of, words_of};
use crate::section::{Section, SectionKind, find, has, slots};
use crate::status_code::StatusCode;

/// Bytes of an observed box in a reply.
const OBSERVED_BYTES: usize = size_of::<ObservedBox>();
const _: () = assert!(OBSERVED_BYTES == 56);
/// Bytes of a filter in a reply.
const FILTER_BYTES: usize = size_of::<[u32; FILTER_WORDS]>();

/// Flag of an observed box: the index has one.
const PRESENT: u32 = 1;
/// Flag of an observed box: it is enabled.
const ENABLED: u32 = 2;

/// What an index of a shared scene has.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ObservedBox {
    /// Its user data. That of a removed box stays.
    pub user_data: u64,
    /// The index.
    pub index: u32,
    /// How many boxes the index has lost: another number is another box.
    pub incarnation: u32,
    /// The box; [`Aabb::EMPTY`] where there is none.
    pub aabb: Aabb,
    /// Its filter data, with its static flag.
    pub filter_data: FilterData,
    flags: u32,
}

impl ObservedBox {
    /// An index whose box is removed.
    pub const fn removed(index: u32, incarnation: u32) -> Self {
        Self {
            user_data: 0,
            index,
            incarnation,
            aabb: Aabb::EMPTY,
            filter_data: FilterData::new(
                pairmask_core::filters::World(0),
                pairmask_core::filters::Owner::NONE,
                pairmask_core::filters::FilterId(0),
            ),
            flags: 0,
        }
    }

    /// The same with a box that is enabled or not.
    #[must_use]
    pub const fn with_box(self, aabb: Aabb, is_enabled: bool) -> Self {
        Self { aabb, flags: PRESENT | if is_enabled { ENABLED } else { 0 }, ..self }
    }

    /// Whether the index has a box.
    pub const fn is_present(&self) -> bool {
        self.flags & PRESENT != 0
    }

    /// Whether the box is enabled.
    pub const fn is_enabled(&self) -> bool {
        self.flags & ENABLED != 0
    }
}

/// An observer's question: what a client says in a header, and what a daemon has validated of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObserveRequest {
    /// The membership of the shared scene.
    pub scene: SceneId,
    /// Changes after this tick are asked for; 0 for all boxes.
    pub after: u64,
}

impl ObserveRequest {
    pub(crate) const fn parse(header: &RequestHeader) -> Self {
        Self { scene: SceneId(header.scene), after: header.base }
    }
}

impl RequestHeader {
    /// An observer's question.
    pub fn observe_shared(client_token: u64, frame: u64, request: &ObserveRequest) -> Self {
        Self {
            scene: request.scene.0,
            base: request.after,
            ..Self::envelope(Operation::ObserveShared, client_token, frame)
        }
    }
}

/// What an observer is answered.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed {
    /// The last tick that is in it. Removals by a member's end may be later ones.
    pub tick: u64,
    /// Whether these are all boxes that there are, whatever was asked for, and others are gone.
    pub is_whole: bool,
    /// By rising index.
    pub boxes: Vec<ObservedBox>,
    /// The table of filters, where it may have changed.
    pub filters: Option<FilterTable>,
}

impl Observed {
    fn sections(&self) -> impl Iterator<Item = Section> {
        let boxes = (self.boxes.len() * OBSERVED_BYTES) as u64;
        let filters = self.filters.as_ref().map(|table| {
            let bytes = (table.filters().len() * FILTER_BYTES) as u64;
            Section::required(SectionKind::RuleFilters, boxes, bytes)
        });
        [Section::required(SectionKind::ObservedBoxes, 0, boxes)].into_iter().chain(filters)
    }

    /// Bytes of the payload of an answer with so many boxes and filters.
    pub const fn payload_bytes(boxes: usize, filters: usize) -> usize {
        boxes * OBSERVED_BYTES + filters * FILTER_BYTES
    }

    /// Words of the payload.
    pub fn payload_words(&self) -> usize {
        self.sections().map(|section| section.bytes as usize).sum::<usize>() / size_of::<u32>()
    }

    /// Writes the payload, and returns the header. `payload` has [so many](Self::payload_words) words at the least.
    pub fn write(&self, fields: &ReplyFields, payload: &mut [u32]) -> ResponseHeader {
        let filters = self.filters.iter().flat_map(FilterTable::filters).flat_map(words_of);
        let boxes: &[u32] = bytemuck::cast_slice(&self.boxes);
        payload.iter_mut().zip(boxes.iter().copied().chain(filters)).for_each(|(to, w)| *to = w);
        let mut header =
            ResponseHeader { sections: slots(self.sections()), ..envelope(fields, StatusCode::Ok) };
        (header.detail[0], header.detail[1]) = (self.tick, self.is_whole.into());
        header
    }
}

/// A validated answer to an observer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObserveReply {
    /// The last tick that is in it. Removals by a member's end may be later ones.
    pub tick: u64,
    /// Whether all boxes are in it, and others are gone.
    pub is_whole: bool,
    boxes: Section,
    filters: Option<Section>,
}

impl ObserveReply {
    /// Checks a copied header against the request's fields and the payload's length.
    ///
    /// # Errors
    /// [`ReplyError`] with the first field that is wrong.
    pub fn parse(
        header: &ResponseHeader,
        asked: &ReplyFields,
        payload_bytes: u64,
    ) -> Result<Self, ReplyError> {
        Reply::check_envelope(header, asked)?;
        let bytes = OBSERVED_BYTES as u64;
        let boxes = find(&header.sections, SectionKind::ObservedBoxes, bytes, payload_bytes);
        let boxes = boxes.ok_or(ReplyError::Malformed { field: "observed boxes" })?;
        let kind = SectionKind::RuleFilters;
        let filters = find(&header.sections, kind, FILTER_BYTES as u64, payload_bytes);
        if has(&header.sections, kind) && filters.is_none() {
            return Err(ReplyError::Malformed { field: "filters" });
        }
        Ok(Self { tick: header.detail[0], is_whole: header.detail[1] != 0, boxes, filters })
    }

    /// Copies the boxes and filters, which another process may write meanwhile, and checks the copy: rising indices, each
    /// below `index_end`.
    ///
    /// # Errors
    /// [`ReplyError::Malformed`].
    pub fn read(&self, pages: &[Page], index_end: u32) -> Result<Observed, ReplyError> {
        let malformed = ReplyError::Malformed { field: "observed boxes" };
        let boxes = self.boxes.entries_in::<ObservedBox>(pages).ok_or(malformed)?.to_vec();
        let is_rising = boxes.is_sorted_by(|a, b| a.index < b.index);
        let is_within = boxes.last().is_none_or(|last| last.index < index_end);
        if !is_rising || !is_within {
            return Err(malformed);
        }
        let malformed = ReplyError::Malformed { field: "filters" };
        let table = |section: Section| {
            let words = section.entries_in::<[u32; FILTER_WORDS]>(pages)?;
            let filters: Vec<Filter> = words.iter().map(filter_of).collect();
            FilterTable::new(&filters).ok()
        };
        let table = self.filters.map(|section| table(section).ok_or(malformed));
        let Self { tick, is_whole, .. } = *self;
        Ok(Observed { tick, is_whole, boxes, filters: table.transpose()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Request;
    use pairmask_core::units::BoxCount;

    const PAGE: u64 = size_of::<Page>() as u64;
    const FIELDS: ReplyFields =
        ReplyFields { client_token: 1, frame: 2, box_count: BoxCount::new(0) };

    /// Boxes of a tick, with two filters.
    fn observed(boxes: &[ObservedBox]) -> Observed {
        let table = FilterTable::new(&[Filter::new(1, 2).with_group(-3), Filter::ALL]);
        let filters = Some(table.expect("two filters"));
        Observed { tick: 70, is_whole: true, boxes: boxes.to_vec(), filters }
    }

    /// Writes an answer, forges its header, and reads it.
    fn read(observed: &Observed, forge: fn(&mut ResponseHeader)) -> Result<(), ReplyError> {
        let mut pages: Vec<Page> = vec![Zeroable::zeroed(); 1];
        let words = bytemuck::cast_slice_mut(&mut pages);
        let mut header = observed.write(&FIELDS, &mut words[..observed.payload_words()]);
        forge(&mut header);
        let reply = ObserveReply::parse(&header, &FIELDS, PAGE)?;
        reply.read(&pages, 9).map(|read| assert_eq!(read, *observed))
    }

    #[test]
    fn what_is_written_is_read() {
        let request = ObserveRequest { scene: SceneId(3), after: 41 };
        let header = RequestHeader::observe_shared(1, 2, &request);
        assert_eq!(Request::parse(&header, 0), Ok(Request::ObserveShared(request)));
        let aabb = Aabb::new([1.0; 3], [2.0; 3]);
        let off = ObservedBox::removed(4, 7).with_box(aabb, false);
        assert!(off.is_present() && !off.is_enabled());
        let boxes = [ObservedBox::removed(0, 1), off, off.with_box(aabb, true)];
        let boxes = [boxes[0], boxes[1], ObservedBox { index: 8, user_data: 9, ..boxes[2] }];
        assert!(!boxes[0].is_present() && boxes[2].is_enabled());
        for of in [observed(&boxes), observed(&[])] {
            assert_eq!(read(&of, |_| ()), Ok(()));
            for filters in [None, Some(FilterTable::default())] {
                assert_eq!(read(&Observed { filters, ..of.clone() }, |_| ()), Ok(()));
            }
        }
    }

    #[test]
    fn forged_answers_are_refused() {
        let of = |indices: [u32; 2]| observed(&indices.map(|index| ObservedBox::removed(index, 0)));
        assert_eq!(read(&of([0, 8]), |_| ()), Ok(()));
        for indices in [[0, 9], [3, 3], [4, 2]] {
            assert!(read(&of(indices), |_| ()).is_err(), "{indices:?}");
        }
        for forge in [
            (|h| h.frame = 3) as fn(&mut ResponseHeader),
            |h| h.sections[0].bytes += 1,
            |h| h.sections[0].bytes = PAGE + 56,
            |h| h.sections[0] = Section::default(),
            |h| h.sections[2] = h.sections[0],
            |h| h.sections[1].bytes -= 4,
            |h| h.sections[1].offset = PAGE,
            |h| h.sections[2] = h.sections[1],
        ] {
            assert!(read(&of([0, 8]), forge).is_err());
        }
    }
}
