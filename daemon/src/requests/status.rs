//! Requests for the daemon's status.

use pairmask_core::engine::CullError;
use pairmask_wire::{PAGE_BYTES, StatusBody};

use crate::publish::{OpenRequest, Outbox};

const _: () = assert!(size_of::<StatusBody>() <= PAGE_BYTES, "a status fits one page");

/// Tells how the daemon does.
pub(super) fn answer(open: &mut OpenRequest, outbox: &Outbox) {
    match open.put(bytemuck::bytes_of(&outbox.status())) {
        Ok(()) => outbox.answer_status(open),
        Err(error) => outbox.refuse(open, &CullError::from(error).into()),
    }
}
