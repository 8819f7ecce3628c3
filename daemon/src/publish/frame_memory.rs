//! A request and the loan of its reply as the memory of a frame.
#![allow(unsafe_code)]

use pairmask_core::engine::ReplyBuffer;
use pairmask_core::objects::Objects;

use super::OpenRequest;
use crate::execute::FrameMemory;

// SAFETY: boxes and loan lie in the shared memory of a request and a response, which stay mapped where
// they are as long as these are held, wherever the value that holds them is moved. The objects were
// placed once, before the value becomes the memory of a frame, and the payload's length is a copy: the
// objects are the same each time. A loan is written by its holder alone until it is sent, which takes
// the value back first. The segment of replies belongs to the server port, which a worker holds longer
// than its engines, and which never maps it anew (`transport::services`: a static allocation). Its pages are
// given back where nobody lends them and no GPU has them (`ReplyMemory::give_back`).
unsafe impl FrameMemory for OpenRequest {
    fn with<R>(&mut self, work: impl FnOnce(Objects<'_>, &mut dyn ReplyBuffer) -> R) -> R {
        let (objects, mut reply) = self.parts();
        work(objects, &mut reply)
    }
}
