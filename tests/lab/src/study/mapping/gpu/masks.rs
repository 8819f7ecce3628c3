//! All pairs by the paper's mapping: one byte or one bit a pair, kernel and transfer
//! (Avril et al. 2012, table 5, figures 3 and 4).

use bytemuck::cast_slice;
use pairmask_core::aabb::KeyBox;
use pairmask_core::{Aabb, BoxCount};
use pairmaskd::execute::gpu::{Command, GpuError, Part};

use super::times::median_ms;
use super::{Bench, zeroed};
use crate::study::mapping::Budget;
use crate::study::mapping::layouts::MaskParams;
use crate::study::mapping::stage::{MappingStage, PairOutput};

/// The threads that write a word of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writer {
    /// One thread computes all pairs of the word.
    ThreadAWord,
    /// One thread a pair; each ORs its result in, as in the paper.
    ThreadAPair,
}

/// One measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskRun {
    /// Time of the upload of the boxes, of the kernel, and of the transfer back, in ms.
    pub upload_ms: f64,
    /// See above.
    pub kernel_ms: f64,
    /// See above.
    pub transfer_ms: f64,
    /// Bytes that went up.
    pub input_bytes: u64,
    /// Bytes that came back.
    pub output_bytes: u64,
    /// The output.
    pub words: Vec<u32>,
}

/// All pairs of `boxes`, measured.
///
/// # Errors
/// [`GpuError`].
pub fn run(
    bench: &mut Bench,
    output: PairOutput,
    writer: Writer,
    boxes: &[Aabb],
    budget: &Budget,
) -> Result<Option<MaskRun>, GpuError> {
    let n = BoxCount::of_len(boxes.len()).unwrap_or_default();
    let pairs = n.pair_count();
    let words = pairs.div_ceil(u64::from(output.pairs_per_word()));
    let threads = match writer {
        Writer::ThreadAWord => words,
        Writer::ThreadAPair => pairs,
    };
    let (Some(groups), Ok(pair_count)) = (bench.groups(threads), u32::try_from(pairs)) else {
        return Ok(None);
    };
    let keys: Vec<[i32; 6]> = boxes
        .iter()
        .map(|b| {
            let KeyBox { min, max } = KeyBox::from(b);
            [min[0], min[1], min[2], max[0], max[1], max[2]]
        })
        .collect();
    let input_bytes = size_of_val(keys.as_slice()) as u64;
    let output_bytes = words * 4;
    let (staged, video_keys) = (bench.host(input_bytes)?, bench.video(input_bytes)?);
    staged.write(0, cast_slice::<_, i32>(&keys));
    let (zeros, video_out, back) =
        (bench.host(output_bytes)?, bench.video(output_bytes)?, bench.host(output_bytes)?);
    zeros.write(0, &zeroed::<u8>(output_bytes as usize));
    let params =
        MaskParams { n: n.get(), pair_count, thread_count: threads as u32, groups_x: groups[0] };
    let stage = match writer {
        Writer::ThreadAWord => MappingStage::Mask(output),
        Writer::ThreadAPair => MappingStage::MaskOr(output),
    };
    let copy = |from, to, bytes| Command::Copy {
        from: Part::of(from, 0, bytes),
        to: Part::of(to, 0, bytes),
    };
    let steps = vec![
        copy(&zeros, &video_out, output_bytes),
        copy(&staged, &video_keys, input_bytes),
        bench.command(stage, &[&video_keys, &video_out], &params, groups)?,
        copy(&video_out, &back, output_bytes),
    ];
    let mut frame = bench.frame(steps)?;
    let (mut uploads, mut kernels, mut transfers) = (Vec::new(), Vec::new(), Vec::new());
    median_ms(budget, || {
        let steps = bench.run(&mut frame)?;
        let ms = |step: usize| steps.get(step).map_or(f64::NAN, |step| step.ns * 1e-6);
        uploads.push(ms(1));
        kernels.push(ms(2));
        transfers.push(ms(3));
        Ok(ms(2))
    })?;
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let mut words: Vec<u32> = zeroed(words as usize);
    back.read(0, &mut words);
    Ok(Some(MaskRun {
        upload_ms: median(&mut uploads),
        kernel_ms: median(&mut kernels),
        transfer_ms: median(&mut transfers),
        input_bytes,
        output_bytes,
        words,
    }))
}
