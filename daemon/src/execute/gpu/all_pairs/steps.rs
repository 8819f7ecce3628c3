//! The stages of a frame with what they bind.

use std::sync::Arc;

use bytemuck::NoUninit;
use pairmask_core::mask::{MaskShape, Span};
use pairmask_core::{BoxCount, BoxForm, Encoding, ObjectForm};
use pairmask_shaders::constants::{BATCH_BOXES, PAIRS_WORKGROUP};
use pairmask_shaders::layouts::{
    BatchReport, BatchTotals, KeysParams, PackParams, PairsParams, WriteParams,
};
use pairmask_shaders::{PairsVariant, Stage};

use super::plan::{Band, plane_words};
use crate::execute::gpu::{
    Command, Gpu, GpuError, Growing, Home, MAX_STEPS, Part, Pipelines, Tuning, frame_blocks,
};

/// Bands of a frame: two steps each, after the keys.
pub(super) const BANDS_PER_FRAME: usize = (MAX_STEPS - 1) / 2;

/// Workgroups along x when one dimension does not hold them all.
const GROUPS_X: u32 = 32_768;

/// The stages that frames of boxes of these tunings use. Those of spheres are compiled when the first frame
/// of spheres comes: each device that is opened would take longer by them.
pub(super) fn stages_of(tunings: &[Tuning]) -> impl Iterator<Item = Stage> {
    let pairs = tunings.iter().flat_map(|tuning| {
        [true, false].map(|store_zeros| Stage::Pairs(variant(*tuning, store_zeros)))
    });
    let keys = BoxForm::ALL.into_iter().map(Stage::Keys);
    keys.chain([Stage::PackDense, Stage::WriteSparse, Stage::WriteList]).chain(pairs)
}

fn variant(tuning: Tuning, store_zeros: bool) -> PairsVariant {
    PairsVariant { rows: tuning.rows, strip_blocks: tuning.strip_blocks, store_zeros }
}

pub(super) struct Recording<'a> {
    pub(super) n: BoxCount,
    pub(super) form: ObjectForm,
    pub(super) tuning: Tuning,
    pub(super) stages: &'a Stages,
    pub(super) mask: &'a Part,
    /// The sections in it; a sparse mask or a list at its full capacity.
    pub(super) shape: MaskShape,
    pub(super) capacity: u64,
    pub(super) offset_align: u64,
}

impl Recording<'_> {
    /// The steps over some bands, after the keys if `boxes` are given.
    pub(super) fn steps(
        &self,
        pipelines: &mut Pipelines,
        boxes: Option<&Part>,
        bands: &[Band],
    ) -> Result<Vec<Command>, GpuError> {
        let mut steps = Vec::with_capacity(1 + 2 * bands.len());
        if let Some(boxes) = boxes {
            steps.push(self.keys(pipelines, boxes)?);
        }
        for band in bands {
            steps.push(self.pairs(pipelines, band)?);
            steps.push(match self.shape {
                MaskShape::Dense { .. } => self.pack_dense(pipelines, band)?,
                shape => self.write(pipelines, band, shape)?,
            });
        }
        Ok(steps)
    }

    fn stage(
        &self,
        pipelines: &mut Pipelines,
        stage: Stage,
        own: &[(&'static str, &Part)],
        params: &impl NoUninit,
        groups: [u32; 2],
    ) -> Result<Command, GpuError> {
        let parts = [self.stages.named().as_slice(), own].concat();
        Command::stage(pipelines.get(stage)?, &parts, params, groups)
    }

    fn keys(&self, pipelines: &mut Pipelines, boxes: &Part) -> Result<Command, GpuError> {
        let plane_words = plane_words(self.n) as u32;
        let params = KeysParams { n: self.n.get(), plane_words };
        let stage = match self.form {
            ObjectForm::Boxes(form) => Stage::Keys(form),
            ObjectForm::Spheres => Stage::SphereKeys,
        };
        let groups = [plane_words / BATCH_BOXES, 1];
        self.stage(pipelines, stage, &[("boxes", boxes)], &params, groups)
    }

    fn matrix(&self, band: &Band) -> Part {
        Part::of(&self.stages.matrix.block, 0, 4 * band.matrix_words())
    }

    fn masks(&self, band: &Band) -> Part {
        Part::of(&self.stages.strip_masks.block, 0, 4 * band.mask_words())
    }

    fn pairs(&self, pipelines: &mut Pipelines, band: &Band) -> Result<Command, GpuError> {
        let dense = matches!(self.shape, MaskShape::Dense { .. });
        let params = PairsParams {
            plane_words: plane_words(self.n) as u32,
            row0: band.row0,
            band_rows: band.matrix_rows,
            strip0: band.strip0,
            counted_end: band.row0 + band.owned_rows,
        };
        let variant = variant(self.tuning, dense);
        let stage = match self.form {
            ObjectForm::Boxes(_) => Stage::Pairs(variant),
            ObjectForm::Spheres => Stage::SpherePairs(variant),
        };
        let own = [("matrix", &self.matrix(band)), ("strip_masks", &self.masks(band))];
        let tile_rows = PAIRS_WORKGROUP * self.tuning.rows as u32;
        let groups = [band.matrix_rows / tile_rows, band.strip_end - band.strip0];
        self.stage(pipelines, stage, &own, &params, groups)
    }

    /// The words of a sparse mask, or the pairs of a list, to their sections.
    fn write(
        &self,
        pipelines: &mut Pipelines,
        band: &Band,
        shape: MaskShape,
    ) -> Result<Command, GpuError> {
        let (stage, names): (_, &[&str]) = match shape.encoding() {
            Encoding::List => (Stage::WriteList, &["out_pairs"]),
            _ => (Stage::WriteSparse, &["out_rows", "out_blocks", "out_bits"]),
        };
        let params = WriteParams {
            row0: band.row0,
            band_rows: band.matrix_rows,
            strip0: band.strip0,
            strip_end: band.strip_end,
            strip_blocks: self.tuning.strip_blocks,
            capacity: self.capacity as u32,
        };
        let mask = self.mask;
        let section =
            |span: Span| Part::of(&mask.block, mask.offset + 4 * span.start, 4 * span.len);
        let sections: Vec<Part> = shape.spans().map(section).collect();
        debug_assert_eq!(names.len(), sections.len(), "a section for each part");
        let mut own: Vec<_> = names.iter().copied().zip(&sections).collect();
        let (matrix, masks) = (self.matrix(band), self.masks(band));
        own.extend([("matrix", &matrix), ("strip_masks", &masks)]);
        let groups = [band.owned_rows.div_ceil(BATCH_BOXES), 1];
        self.stage(pipelines, stage, &own, &params, groups)
    }

    fn pack_dense(&self, pipelines: &mut Pipelines, band: &Band) -> Result<Command, GpuError> {
        let words = band.dense_words(self.n);
        let word_count = (words.end - words.start) as u32;
        // A binding starts where the device lets it; the rest of the way is an offset.
        let mask = self.mask;
        let byte = mask.offset + 4 * words.start;
        let bound = byte / self.offset_align * self.offset_align;
        let groups = word_count.div_ceil(BATCH_BOXES).max(1);
        let params = PackParams {
            n: self.n.get(),
            row0: band.row0,
            owned_rows: band.owned_rows,
            band_rows: band.matrix_rows,
            block0: band.strip0 * self.tuning.strip_blocks,
            word_count,
            first_bit: (32 * words.start - band.first_pair(self.n)) as u32,
            out_offset: ((byte - bound) / 4) as u32,
            groups_x: groups.min(GROUPS_X),
        };
        let words = Part::of(&mask.block, bound, (byte - bound) + 4 * u64::from(word_count.max(1)));
        let own = [("matrix", &self.matrix(band)), ("out_words", &words)];
        let groups = [params.groups_x, groups.div_ceil(params.groups_x)];
        self.stage(pipelines, Stage::PackDense, &own, &params, groups)
    }
}

frame_blocks! { Scratch, Stages:
    keys in Video,
    totals in Video,
    matrix in Video,
    strip_masks in Video,
    reports in Host,
}

impl Scratch {
    pub(super) fn stages(
        &mut self,
        gpu: &Arc<Gpu>,
        n: BoxCount,
        bands: &[Band],
        replaced: &mut bool,
    ) -> Result<Stages, GpuError> {
        let plane = plane_words(n);
        let batches = plane / u64::from(BATCH_BOXES);
        let most = |words: fn(&Band) -> u64| 4 * bands.iter().map(words).max().unwrap_or(0);
        let mut part = |growing: &mut Growing, bytes| growing.part(gpu, bytes, replaced);
        Ok(Stages {
            keys: part(&mut self.keys, 24 * plane)?,
            totals: part(&mut self.totals, batches * size_of::<BatchTotals>() as u64)?,
            matrix: part(&mut self.matrix, most(Band::matrix_words))?,
            strip_masks: part(&mut self.strip_masks, most(Band::mask_words))?,
            reports: part(&mut self.reports, batches * size_of::<BatchReport>() as u64)?,
        })
    }
}
