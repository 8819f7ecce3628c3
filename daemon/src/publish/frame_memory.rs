//! A request and the loan of its reply as the memory of a frame.
#![allow(unsafe_code)]

use pairmask_core::engine::ReplyBuffer;
use pairmask_core::objects::Objects;

use super::OpenRequest;
use crate::execute::FrameMemory;

// SAFETY: boxes and loan lie in shared memory, that of a client and of its answers, which stays mapped where it is as long
// as the request is held, wherever the value that holds it is moved: the request holds its client. The objects were
// placed once, before the value becomes the memory of a frame, and the payload's place is a copy: the objects are the
// same each time. A loan is written by its holder alone until it is sent, which takes the value back first. Memory of
// answers is given back, or unmapped, where nobody lends it and no GPU has it (`transport::Door::tidy`, with
// `Responder::tidy`).
unsafe impl FrameMemory for OpenRequest {
    fn with<R>(&mut self, work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R) -> R {
        let (objects, mut reply) = self.parts();
        work(objects, &mut reply)
    }
}
