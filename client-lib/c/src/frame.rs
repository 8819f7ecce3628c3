//! Frames that are being filled: `pm_frame`.
#![allow(unsafe_code)]

use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use bytemuck::{Pod, Zeroable, cast, cast_slice};
use pairmask::filters::Rules;
use pairmask::{
    Aabb, Bounds, BoxSource, CenterHalf, Error, FrameOptions, MinMax, Placement, Precision,
    Quantized, Sphere, Transformed,
};
use pairmask_core::update::{ToWorld, WorldMatrix};

use crate::call::call;
use crate::code::pm_code::{self, PM_ERR_STATE};
use crate::failure::Failure;
use crate::filters::pm_rules;
use crate::handles::Handle;
use crate::mask::{Mask, pm_mask, pm_pending};
use crate::memory::{In, Out};
use crate::session::pm_session;
use crate::values::{index_count, pm_box, pm_sphere};

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_frame {
    pub id: u64,
}

/// What a `pm_frame` names.
pub enum Frame {
    Boxes(pairmask::Frame),
    Narrow(pairmask::Frame<Quantized>),
    Spheres(pairmask::Frame<Sphere>),
}

pub type pm_form = u32;
pub const PM_FORM_F32: pm_form = 0;
pub const PM_FORM_Q16: pm_form = 1;
pub const PM_FORM_Q8: pm_form = 2;
pub const PM_FORM_F16: pm_form = 3;

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_precision {
    pub form: pm_form,
    pub bounds: pm_box,
}

/// The library's precision.
fn precision_of(precision: &pm_precision) -> Result<Precision, Failure> {
    let bounds = || Bounds::new(precision.bounds.min, precision.bounds.max);
    Ok(match precision.form {
        PM_FORM_F32 => Precision::Exact,
        PM_FORM_Q16 => Precision::Q16(bounds()?),
        PM_FORM_Q8 => Precision::Q8(bounds()?),
        PM_FORM_F16 => Precision::F16,
        _ => return Err(Failure::argument("no such form of boxes")),
    })
}

/// Begins a frame by `make`, and writes where its memory lies if the program asks for it.
fn begin<T: Copy>(
    session: pm_session,
    frame: Out<pm_frame>,
    memory: Out<*mut T>,
    make: impl FnOnce(&mut pairmask::Session) -> Result<(Frame, *mut T), Error>,
) -> pm_code {
    frame.give(|| {
        // Before there is a frame, whose handle the program would not get.
        let memory = memory.if_any();
        memory.map_or(Ok(()), Out::check)?;
        let (begun, at) = session.with(|session| Ok(make(session)?))?;
        let handle = pm_frame::new(begun)?;
        memory.map_or(Ok(()), |memory| memory.write(at))?;
        Ok(handle)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_frame(
    session: pm_session,
    n: usize,
    frame: Out<pm_frame>,
    boxes: Out<*mut pm_box>,
) -> pm_code {
    begin(session, frame, boxes, |session| {
        let mut frame = session.frame(n)?;
        let boxes = frame.boxes_mut().as_mut_ptr().cast();
        Ok((Frame::Boxes(frame), boxes))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_sphere_frame(
    session: pm_session,
    n: usize,
    frame: Out<pm_frame>,
    spheres: Out<*mut pm_sphere>,
) -> pm_code {
    begin(session, frame, spheres, |session| {
        let mut frame = session.sphere_frame(n)?;
        let spheres = frame.spheres_mut().as_mut_ptr().cast();
        Ok((Frame::Spheres(frame), spheres))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_narrow_frame(
    session: pm_session,
    n: usize,
    precision: In<pm_precision>,
    frame: Out<pm_frame>,
) -> pm_code {
    frame.give(|| {
        let precision = precision_of(&precision.value()?)?;
        pm_frame::new(Frame::Narrow(session.with(|s| Ok(s.narrow_frame(n, precision)?))?))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_frame_drop(frame: pm_frame) -> pm_code {
    frame.drop()
}

const OTHER_FRAME: Failure = Failure::new(PM_ERR_STATE, "the frame is of another kind of objects");

/// Writes a frame's boxes from anything that holds them. There must be as many.
fn write(frame: pm_frame, boxes: &(impl BoxSource + Sync + ?Sized)) -> Result<(), Failure> {
    frame.with(|frame| {
        match frame {
            Frame::Boxes(frame) => frame.write(boxes)?,
            Frame::Narrow(frame) => frame.write(boxes)?,
            Frame::Spheres(_) => return Err(OTHER_FRAME),
        }
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_frame_write(frame: pm_frame, boxes: In<pm_box>, n: usize) -> pm_code {
    call(|| write(frame, cast_slice::<_, Aabb>(boxes.array(n)?)))
}

/// Points of three floats each.
fn points(floats: In<f32>, count: usize) -> Result<&'static [[f32; 3]], Failure> {
    // Where a `usize` does not hold the number of floats, memory does not hold them either.
    Ok(cast_slice(floats.array(count.saturating_mul(3))?))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_frame_write_corners(
    frame: pm_frame,
    min: In<f32>,
    max: In<f32>,
    n: usize,
) -> pm_code {
    call(|| write(frame, &MinMax::points(points(min, n)?, points(max, n)?)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_frame_write_centers(
    frame: pm_frame,
    center: In<f32>,
    half: In<f32>,
    n: usize,
) -> pm_code {
    call(|| write(frame, &CenterHalf::points(points(center, n)?, points(half, n)?)))
}

#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_placement {
    pub translation: [f32; 3],
    pub rotation: [f32; 4],
    pub scale: [f32; 3],
}

impl pm_placement {
    const fn placement(&self) -> Placement {
        let Self { translation, rotation, scale } = *self;
        Placement { translation, rotation, scale }
    }
}

impl ToWorld for pm_placement {
    fn world_matrix(&self) -> WorldMatrix {
        self.placement().world_matrix()
    }

    fn world_matrix_with_default_flags(&self) -> WorldMatrix {
        self.placement().world_matrix_with_default_flags()
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_frame_write_placed(
    frame: pm_frame,
    locals: In<pm_box>,
    placements: In<pm_placement>,
    n: usize,
) -> pm_code {
    call(|| write(frame, &Transformed::new(cast_slice(locals.array(n)?), placements.array(n)?)))
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_frame_set(frame: pm_frame, index: u32, b: In<pm_box>) -> pm_code {
    call(|| {
        let (b, index) = (cast(b.value()?), index as usize);
        let beyond = Failure::argument("an index beyond the frame");
        frame.with(|frame| {
            match frame {
                Frame::Boxes(frame) => *frame.boxes_mut().get_mut(index).ok_or(beyond)? = b,
                Frame::Narrow(frame) if index < frame.n().len() => frame.set(index, &b),
                Frame::Narrow(_) => return Err(beyond),
                Frame::Spheres(_) => return Err(OTHER_FRAME),
            }
            Ok(())
        })
    })
}

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_frame_options {
    pub struct_size: usize,
    pub filters: pm_rules,
    pub two_sets: u32,
    pub split_at: u32,
}

growing!(pm_frame_options);

/// The filters that a handle names; none for zero.
fn filters_named(filters: pm_rules) -> Result<Option<Arc<Rules>>, Failure> {
    (filters.id != 0).then(|| filters.with(|rules| Ok(Arc::clone(rules)))).transpose()
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_frame_submit(
    frame: pm_frame,
    options: In<pm_frame_options>,
    pending: Out<pm_pending>,
) -> pm_code {
    call(|| {
        let frame = frame.remove()?;
        pending.check()?;
        let given = options.growing()?;
        let split_at = (given.two_sets != 0).then_some(given.split_at as usize);
        let options = FrameOptions { filters: filters_named(given.filters)?, split_at };
        let sent = match frame {
            Frame::Boxes(frame) => frame.submit_with(&options),
            Frame::Narrow(frame) => frame.submit_with(&options),
            Frame::Spheres(frame) => frame.submit_with(&options),
        };
        pending.write(pm_pending::new(sent?)?)
    })
}

/// How often to look for a free slot where frames and masks hold all: about the time of a small frame.
const SLOT_INTERVAL: Duration = Duration::from_micros(50);

#[unsafe(no_mangle)]
pub extern "C" fn pm_session_cull(
    session: pm_session,
    boxes: In<pm_box>,
    n: usize,
    filters: pm_rules,
    mask: Out<pm_mask>,
) -> pm_code {
    mask.give(|| {
        index_count(n)?;
        let boxes: &[Aabb] = cast_slice(boxes.array(n)?);
        let options = FrameOptions { filters: filters_named(filters)?, split_at: None };
        let until = Instant::now() + session.with(|s| Ok(s.deadline()))?;
        let mut frame = loop {
            match session.with(|s| Ok(s.frame(n)))? {
                Err(Error::TooManyFrames) if Instant::now() < until => sleep(SLOT_INTERVAL),
                frame => break frame?,
            }
        };
        frame.write(boxes)?;
        pm_mask::new(Mask::new(frame.submit_with(&options)?.wait()?))
    })
}
