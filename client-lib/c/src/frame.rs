//! Frames that are being filled: `pm_frame`.
#![allow(unsafe_code)]

use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use pairmask::filters::Rules;
use pairmask::{
    Bounds, BoxSource, CenterHalf, Error, FrameOptions, MinMax, Placement, Precision, Quantized,
    Sphere, ToWorld, Transformed,
};
use pairmask_core::update::WorldMatrix;

use crate::call::call;
use crate::code::{PM_ERR_STATE, pm_code};
use crate::failure::Failure;
use crate::handles::handle;
use crate::mask::{Mask, Pending, pm_mask, pm_pending};
use crate::memory::{Growing, array, check_out, growing, value, write};
use crate::rules::pm_rules;
use crate::session::pm_session;
use crate::spares::Spares;
use crate::values::{boxes as as_boxes, index_count, pm_box, pm_sphere, spheres_mut};

/// Memory for the boxes or spheres of one frame: shared memory where a daemon serves. Its contents are
/// unspecified: write every box. A daemon has three frames of a session at a time, in any mix of being filled, under
/// way and held as masks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct pm_frame {
    /// Zero for none.
    pub id: u64,
}

/// What a `pm_frame` names.
pub struct Frame {
    filling: Filling,
    n: usize,
    spares: Spares,
}

enum Filling {
    Boxes(pairmask::Frame),
    Narrow(pairmask::Frame<Quantized>),
    Spheres(pairmask::Frame<Sphere>),
}

handle!(pm_frame is Frame);

/// The form in which boxes are sent: one of `PM_FORM_...`.
pub type pm_form = u32;
/// 24 bytes a box, exact.
pub const PM_FORM_F32: pm_form = 0;
/// 12 bytes a box, in steps of the bounds' extent / 65,534.
pub const PM_FORM_Q16: pm_form = 1;
/// 6 bytes a box, in steps of the bounds' extent / 254.
pub const PM_FORM_Q8: pm_form = 2;
/// 12 bytes a box, half floats.
pub const PM_FORM_F16: pm_form = 3;

/// How boxes are sent that may add pairs, and miss none.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct pm_precision {
    /// `PM_FORM_...`.
    pub form: pm_form,
    /// Bounds of the world, for `PM_FORM_Q16` and `PM_FORM_Q8`.
    pub bounds: pm_box,
}

/// The library's precision.
pub fn precision_of(precision: &pm_precision) -> Result<Precision, Failure> {
    let bounds = || Bounds::new(precision.bounds.min, precision.bounds.max);
    Ok(match precision.form {
        PM_FORM_F32 => Precision::Exact,
        PM_FORM_Q16 => Precision::Q16(bounds()?),
        PM_FORM_Q8 => Precision::Q8(bounds()?),
        PM_FORM_F16 => Precision::F16,
        _ => return Err(Failure::argument("no such form of boxes")),
    })
}

const fn other_frame() -> Failure {
    Failure::new(PM_ERR_STATE, "the frame is of another kind of objects")
}

/// Begins a frame of `n` boxes. `boxes`, which may be null, is set to their memory, which is the caller's to
/// write until the frame is submitted or dropped.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_session_frame(
    session: pm_session,
    n: usize,
    frame: *mut pm_frame,
    boxes: *mut *mut pm_box,
) -> pm_code {
    call(|| {
        check_out(frame)?;
        // Before there is a frame, which nobody would have a handle of.
        if !boxes.is_null() {
            check_out(boxes)?;
        }
        let (mut filling, spares) =
            session.with(|s| Ok((s.session.frame(n)?, s.spares.clone())))?;
        let memory = filling.boxes_mut().as_mut_ptr().cast();
        let made = pm_frame::new(Frame { filling: Filling::Boxes(filling), n, spares })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            if !boxes.is_null() {
                write(boxes, memory)?;
            }
            write(frame, made)
        }
    })
}

/// Begins a frame of `n` spheres. `spheres`, which may be null, is set to their memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_session_sphere_frame(
    session: pm_session,
    n: usize,
    frame: *mut pm_frame,
    spheres: *mut *mut pm_sphere,
) -> pm_code {
    call(|| {
        check_out(frame)?;
        if !spheres.is_null() {
            check_out(spheres)?;
        }
        let (mut filling, spares) =
            session.with(|s| Ok((s.session.sphere_frame(n)?, s.spares.clone())))?;
        let memory = spheres_mut(filling.spheres_mut()).as_mut_ptr();
        let made = pm_frame::new(Frame { filling: Filling::Spheres(filling), n, spares })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            if !spheres.is_null() {
                write(spheres, memory)?;
            }
            write(frame, made)
        }
    })
}

/// Begins a frame of `n` boxes that are sent with less precision. They are written with `pm_frame_write` and
/// `pm_frame_set`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_session_narrow_frame(
    session: pm_session,
    n: usize,
    precision: *const pm_precision,
    frame: *mut pm_frame,
) -> pm_code {
    call(|| {
        check_out(frame)?;
        // SAFETY: the caller's promise about pointers is passed on.
        let precision = precision_of(&unsafe { value(precision) }?)?;
        let (filling, spares) =
            session.with(|s| Ok((s.session.narrow_frame(n, precision)?, s.spares.clone())))?;
        let made = pm_frame::new(Frame { filling: Filling::Narrow(filling), n, spares })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(frame, made) }
    })
}

/// Drops a frame that is not submitted.
#[unsafe(no_mangle)]
pub extern "C" fn pm_frame_drop(frame: pm_frame) -> pm_code {
    frame.drop()
}

/// The memory of a frame's boxes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_frame_boxes(
    frame: pm_frame,
    boxes: *mut *mut pm_box,
    n: *mut usize,
) -> pm_code {
    call(|| {
        check_out(boxes)?;
        check_out(n)?;
        let (memory, len) = frame.with(|frame| match &mut frame.filling {
            Filling::Boxes(frame) => {
                let boxes = frame.boxes_mut();
                Ok((boxes.as_mut_ptr().cast(), boxes.len()))
            }
            _ => Err(other_frame()),
        })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            write(boxes, memory)?;
            write(n, len)
        }
    })
}

/// The memory of a frame's spheres.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_frame_spheres(
    frame: pm_frame,
    spheres: *mut *mut pm_sphere,
    n: *mut usize,
) -> pm_code {
    call(|| {
        check_out(spheres)?;
        check_out(n)?;
        let (memory, len) = frame.with(|frame| match &mut frame.filling {
            Filling::Spheres(frame) => {
                let spheres = frame.spheres_mut();
                Ok((spheres_mut(spheres).as_mut_ptr(), spheres.len()))
            }
            _ => Err(other_frame()),
        })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            write(spheres, memory)?;
            write(n, len)
        }
    })
}

/// Writes a frame's boxes from whatever holds them. There must be as many.
fn write_boxes(frame: &mut Frame, boxes: &(impl BoxSource + Sync + ?Sized)) -> Result<(), Failure> {
    match &mut frame.filling {
        Filling::Boxes(frame) => frame.write(boxes)?,
        Filling::Narrow(frame) => frame.write(boxes)?,
        Filling::Spheres(_) => return Err(other_frame()),
    }
    Ok(())
}

/// Copies all boxes of a frame from an array. Large frames are copied by several threads.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_frame_write(
    frame: pm_frame,
    boxes: *const pm_box,
    n: usize,
) -> pm_code {
    call(|| {
        // SAFETY: the caller's promise about pointers is passed on.
        let boxes = as_boxes(unsafe { array(boxes, n) }?);
        frame.with(|frame| write_boxes(frame, boxes))
    })
}

/// Points of three floats each.
///
/// # Safety
/// As [`array`], for three times `count` floats.
unsafe fn points(floats: *const f32, count: usize) -> Result<&'static [[f32; 3]], Failure> {
    // SAFETY: the caller's promise about pointers is passed on. Where so many floats are beyond what a number
    // can say, so are they beyond memory.
    Ok(bytemuck::cast_slice(unsafe { array(floats, count.saturating_mul(3)) }?))
}

/// Writes all boxes of a frame from their smallest and largest corners, three floats each.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_frame_write_corners(
    frame: pm_frame,
    min: *const f32,
    max: *const f32,
    n: usize,
) -> pm_code {
    call(|| {
        // SAFETY: the caller's promise about pointers is passed on.
        let (min, max) = unsafe { (points(min, n)?, points(max, n)?) };
        frame.with(|frame| write_boxes(frame, &MinMax::points(min, max)))
    })
}

/// Writes all boxes of a frame from their centres and half extents, three floats each.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_frame_write_centers(
    frame: pm_frame,
    center: *const f32,
    half: *const f32,
    n: usize,
) -> pm_code {
    call(|| {
        // SAFETY: the caller's promise about pointers is passed on.
        let (center, half) = unsafe { (points(center, n)?, points(half, n)?) };
        frame.with(|frame| write_boxes(frame, &CenterHalf::points(center, half)))
    })
}

/// Translation, rotation and scale of an object.
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct pm_placement {
    /// Where the object's origin lies.
    pub translation: [f32; 3],
    /// A quaternion x, y, z, w; w is the real part.
    pub rotation: [f32; 4],
    /// Scale on the object's own axes.
    pub scale: [f32; 3],
}

impl From<pm_placement> for Placement {
    fn from(p: pm_placement) -> Self {
        Self { translation: p.translation, rotation: p.rotation, scale: p.scale }
    }
}

impl ToWorld for pm_placement {
    fn world_matrix(&self) -> WorldMatrix {
        Placement::from(*self).world_matrix()
    }

    fn world_matrix_with_default_flags(&self) -> WorldMatrix {
        Placement::from(*self).world_matrix_with_default_flags()
    }
}

/// Writes all boxes of a frame as what boxes in their objects' own coordinates cover once the objects are
/// placed. They are rounded outward: no pair is lost.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_frame_write_placed(
    frame: pm_frame,
    locals: *const pm_box,
    placements: *const pm_placement,
    n: usize,
) -> pm_code {
    call(|| {
        // SAFETY: the caller's promise about pointers is passed on.
        let (locals, placements) = unsafe { (array(locals, n)?, array(placements, n)?) };
        let boxes = Transformed::new(as_boxes(locals), placements);
        frame.with(|frame| write_boxes(frame, &boxes))
    })
}

/// Writes one box of a frame.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_frame_set(frame: pm_frame, index: u32, b: *const pm_box) -> pm_code {
    call(|| {
        // SAFETY: the caller's promise about pointers is passed on.
        let b = as_boxes(&[unsafe { value(b) }?])[0];
        let beyond = Failure::argument("an index beyond the frame");
        frame.with(|frame| {
            let index = Some(index as usize).filter(|index| *index < frame.n).ok_or(beyond)?;
            match &mut frame.filling {
                Filling::Boxes(frame) => frame.boxes_mut()[index] = b,
                Filling::Narrow(frame) => frame.set(index, &b),
                Filling::Spheres(_) => return Err(other_frame()),
            }
            Ok(())
        })
    })
}

/// What is asked of a frame beside its pairs.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct pm_frame_options {
    /// `sizeof(pm_frame_options)`.
    pub struct_size: usize,
    /// Collision filters, with a tag for each box or with none; zero for none. A daemon gets them once, however many
    /// frames have them.
    pub filters: pm_rules,
    /// Not 0: two sets. Only pairs of one of the first `split_at` boxes and one of the others count.
    pub two_sets: u32,
    /// Boxes of the first set.
    pub split_at: u32,
}

// SAFETY: it is `repr(C)` and begins with its size; integers have no invalid bit patterns.
unsafe impl Growing for pm_frame_options {}

/// The filters that a handle names; none for zero.
fn filters_named(filters: pm_rules) -> Result<Option<Arc<Rules>>, Failure> {
    (filters.id != 0).then(|| filters.with(|rules| Ok(Arc::clone(rules)))).transpose()
}

/// Sends a frame. `options` may be null. The handle names nothing any more, and its memory is not the caller's,
/// whatever is returned.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_frame_submit(
    frame: pm_frame,
    options: *const pm_frame_options,
    pending: *mut pm_pending,
) -> pm_code {
    call(|| {
        let Frame { filling, spares, .. } = frame.remove()?;
        check_out(pending)?;
        let filters = pm_rules::default();
        let struct_size = size_of::<pm_frame_options>();
        let none = pm_frame_options { struct_size, filters, two_sets: 0, split_at: 0 };
        // SAFETY: the caller's promise about pointers is passed on.
        let given = if options.is_null() { none } else { unsafe { growing(options, none) }? };
        let split_at = (given.two_sets != 0).then_some(given.split_at as usize);
        let options = FrameOptions { filters: filters_named(given.filters)?, split_at };
        let sent = match filling {
            Filling::Boxes(frame) => frame.submit_with(&options),
            Filling::Narrow(frame) => frame.submit_with(&options),
            Filling::Spheres(frame) => frame.submit_with(&options),
        };
        let made = pm_pending::new(Pending { pending: sent?, spares })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(pending, made) }
    })
}

/// A place for a frame that others hold is looked for this often: about the time of a small frame.
const PLACE_INTERVAL: Duration = Duration::from_micros(50);

/// Copies boxes, sends them and waits: the shortest way from boxes to pairs. `filters` may be zero. Where frames and
/// masks hold all of the session's places at a daemon, it waits for one, as long as the session's deadline allows.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_session_cull(
    session: pm_session,
    boxes: *const pm_box,
    n: usize,
    filters: pm_rules,
    mask: *mut pm_mask,
) -> pm_code {
    call(|| {
        index_count(n)?;
        check_out(mask)?;
        // SAFETY: the caller's promise about pointers is passed on.
        let boxes = as_boxes(unsafe { array(boxes, n) }?);
        let options = FrameOptions { filters: filters_named(filters)?, split_at: None };
        let begin = || session.with(|s| Ok((s.session.frame(n), s.spares.clone())));
        let until = Instant::now() + session.with(|s| Ok(s.session.deadline()))?;
        let (mut frame, spares) = loop {
            match begin()? {
                (Err(Error::TooManyFrames), _) if Instant::now() < until => {
                    sleep(PLACE_INTERVAL);
                }
                (frame, spares) => break (frame?, spares),
            }
        };
        frame.write(boxes)?;
        let made = Mask::new(frame.submit_with(&options)?.wait()?, spares);
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(mask, pm_mask::new(made)?) }
    })
}
