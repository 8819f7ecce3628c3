//! What a recorded frame asks, as a program asks a session for it: objects in f32, filters, two sets.

use std::sync::Arc;

use pairmask_core::filters::Rules;
use pairmask_core::objects::Objects;
use pairmask_core::precision::ExpandScratch;
use pairmask_core::{Aabb, BoxCount, ObjectForm, Sphere};
use pairmask_wire::{CullRequest, Page, Reject, RulesReader, page_count};

/// A recorded payload as pages, which requests are read from.
pub fn pages_of(payload: &[u8]) -> Vec<Page> {
    let count = page_count(payload.len() as u64) as usize;
    let mut pages: Vec<Page> = vec![bytemuck::Zeroable::zeroed(); count];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut pages);
    bytes[..payload.len()].copy_from_slice(payload);
    pages
}

/// The objects of a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Asked {
    /// Boxes; narrow ones as engines expand them, which have the same pairs.
    Boxes(Vec<Aabb>),
    Spheres(Vec<Sphere>),
}

impl Asked {
    pub const fn len(&self) -> usize {
        match self {
            Self::Boxes(boxes) => boxes.len(),
            Self::Spheres(spheres) => spheres.len(),
        }
    }

    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A frame of a recording.
#[derive(Clone, Debug)]
pub struct AskedFrame {
    pub objects: Asked,
    /// The form in which they were sent.
    pub form: ObjectForm,
    pub filters: Option<Arc<Rules>>,
    pub split_at: Option<usize>,
}

/// Reads the frames of one session, in their order: one may name the filters of an earlier one.
#[derive(Debug, Default)]
pub struct FrameReader {
    rules: RulesReader,
    /// The filters that were read last, and their number. Frames that have them share them.
    last: Option<(u64, Arc<Rules>)>,
}

impl FrameReader {
    pub fn read(&mut self, request: &CullRequest, pages: &[Page]) -> Result<AskedFrame, Reject> {
        let form = request.scene.form;
        let objects = request.scene.objects_in(pages).ok_or(Reject::Objects {
            box_count: request.scene.count.get(),
            payload_bytes: size_of_val(pages) as u64,
        })?;
        let objects = match objects {
            Objects::Boxes(boxes) => {
                let mut scratch = ExpandScratch::default();
                // Expanded boxes are f32 boxes.
                Asked::Boxes(boxes.expand(&mut scratch, false).as_f32().unwrap_or_default().into())
            }
            Objects::Spheres(spheres) => Asked::Spheres(spheres.into()),
        };
        let filters = self.filters(request, pages)?;
        let split_at = request.first_set.map(BoxCount::len);
        Ok(AskedFrame { objects, form, filters, split_at })
    }

    fn filters(
        &mut self,
        request: &CullRequest,
        pages: &[Page],
    ) -> Result<Option<Arc<Rules>>, Reject> {
        let (n, number) = (request.scene.count, request.rules_number);
        let sent = match &request.rules {
            Some(sections) => self.rules.read_named(sections, number, n, pages)?,
            None if number == 0 => return Ok(None),
            None => self.rules.named(number, n)?,
        };
        if let Some((_, rules)) = self.last.as_ref().filter(|(number, _)| *number == sent.number())
        {
            return Ok(Some(Arc::clone(rules)));
        }
        let rules = Arc::new(sent.rules().clone());
        self.last = Some((sent.number(), Arc::clone(&rules)));
        Ok(Some(rules))
    }
}
