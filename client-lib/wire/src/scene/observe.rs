//! An observer's question: which boxes of a shared scene changed, regardless of who wrote them, and what they are now.

use bytemuck::{Pod, Zeroable};
use pairmask_core::aabb::Aabb;
use pairmask_core::filters::FilterData;

use super::request::SceneId;
use crate::header::{Operation, RequestHeader};
use crate::page::Page;
use crate::reply::{Reply, ReplyError, ReplyFields, ResponseHeader, envelope};
use crate::section::{Section, SectionKind, find, slots};
use crate::status_code::StatusCode;

/// Bytes of an observed box in a reply.
pub const OBSERVED_BYTES: usize = size_of::<ObservedBox>();
const _: () = assert!(OBSERVED_BYTES == 56);

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

/// The header of an answer with so many boxes, which begin the payload, as of a tick. `is_whole`: they are all boxes that
/// there are, whatever was asked for.
pub fn response_observed(
    fields: &ReplyFields,
    tick: u64,
    is_whole: bool,
    boxes: usize,
) -> ResponseHeader {
    let mut header = ResponseHeader {
        sections: slots([Section::required(
            SectionKind::ObservedBoxes,
            0,
            (boxes * OBSERVED_BYTES) as u64,
        )]),
        ..envelope(fields, StatusCode::Ok)
    };
    (header.detail[0], header.detail[1]) = (tick, is_whole.into());
    header
}

/// A validated answer to an observer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObserveReply {
    /// The last tick that is in it. Removals by a member's end may be later ones.
    pub tick: u64,
    /// Whether all boxes are in it, and others are gone.
    pub is_whole: bool,
    boxes: Section,
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
        Ok(Self { tick: header.detail[0], is_whole: header.detail[1] != 0, boxes })
    }

    /// Copies the boxes, which another process may write meanwhile, and checks the copy: rising indices, each below
    /// `index_end`.
    ///
    /// # Errors
    /// [`ReplyError::Malformed`].
    pub fn read(&self, pages: &[Page], index_end: u32) -> Result<Vec<ObservedBox>, ReplyError> {
        let malformed = ReplyError::Malformed { field: "observed boxes" };
        let boxes = self.boxes.entries_in::<ObservedBox>(pages).ok_or(malformed)?.to_vec();
        let is_rising = boxes.is_sorted_by(|a, b| a.index < b.index);
        let is_within = boxes.last().is_none_or(|last| last.index < index_end);
        if is_rising && is_within { Ok(boxes) } else { Err(malformed) }
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

    fn read(boxes: &[ObservedBox], header: &ResponseHeader) -> Result<(), ReplyError> {
        let mut pages: Vec<Page> = vec![Zeroable::zeroed(); 1];
        let bytes: &[u8] = bytemuck::cast_slice(boxes);
        bytemuck::cast_slice_mut(&mut pages)[..bytes.len()].copy_from_slice(bytes);
        let reply = ObserveReply::parse(header, &FIELDS, PAGE)?;
        assert_eq!((reply.tick, reply.is_whole), (70, true));
        reply.read(&pages, 9).map(|read| assert_eq!(read, boxes))
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
        assert_eq!(read(&boxes, &response_observed(&FIELDS, 70, true, 3)), Ok(()));
        assert_eq!(read(&[], &response_observed(&FIELDS, 70, true, 0)), Ok(()));
    }

    #[test]
    fn forged_answers_are_refused() {
        let boxes = |indices: [u32; 2]| indices.map(|index| ObservedBox::removed(index, 0));
        let right = response_observed(&FIELDS, 70, true, 2);
        assert_eq!(read(&boxes([0, 8]), &right), Ok(()));
        for indices in [[0, 9], [3, 3], [4, 2]] {
            assert!(read(&boxes(indices), &right).is_err(), "{indices:?}");
        }
        for forge in [
            (|h| h.frame = 3) as fn(&mut ResponseHeader),
            |h| h.sections[0].bytes += 1,
            |h| h.sections[0].bytes = PAGE + 56,
            |h| h.sections[0] = Section::default(),
            |h| h.sections[1] = h.sections[0],
        ] {
            let mut forged = right;
            forge(&mut forged);
            assert!(read(&boxes([0, 8]), &forged).is_err());
        }
    }
}
