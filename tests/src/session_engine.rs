//! A session as an engine, so that the conformance suite runs on every session backend too.

use pairmask::engine::{
    CullError, CullJob, CullReport, Engine, EngineName, EngineTimes, ReplyBuffer,
};
use pairmask::mask::EncodingChoice;
use pairmask::session::SessionBuilder;
use pairmask::{Aabb, Encoding, ServedBy, Session};

/// A session for each encoding, and who must serve it.
#[derive(Debug)]
pub struct SessionEngine {
    dense: Session,
    sparse: Session,
    expected: ServedBy,
}

impl SessionEngine {
    /// Sessions as `builder` describes them. Every frame must be served by `expected`.
    ///
    /// # Panics
    /// When a session cannot be made.
    pub fn new(builder: &SessionBuilder, expected: ServedBy) -> Self {
        let connect = |encoding| {
            builder.clone().encoding(EncodingChoice::Only(encoding)).connect().expect("a session")
        };
        Self { dense: connect(Encoding::Dense), sparse: connect(Encoding::Sparse), expected }
    }
}

impl Engine for SessionEngine {
    fn name(&self) -> EngineName {
        EngineName::CpuBrute
    }

    fn cull(
        &mut self,
        boxes: &[Aabb],
        job: &CullJob,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let session = match job.encoding {
            Encoding::Dense => &mut self.dense,
            Encoding::Sparse => &mut self.sparse,
        };
        let mut frame = session.frame(boxes.len()).expect("memory for a frame");
        frame.boxes_mut().copy_from_slice(boxes);
        let mask = frame.submit().expect("a frame is sent").wait().expect("a frame is answered");
        let info = mask.info();
        assert_eq!(info.served_by, self.expected);
        assert_eq!(mask.pairs().count() as u64, mask.count(), "the decoder finds what was counted");
        mask.view().verify().expect("a mask by the rules");
        let extent = mask.shape().extent_words();
        reply.reserve(extent)?[..extent as usize]
            .copy_from_slice(&mask.reply_words()[..extent as usize]);
        Ok(CullReport {
            shape: *mask.shape(),
            census: info.census,
            pair_count: mask.count(),
            skipped: info.skipped,
            times: EngineTimes {
                ingest_ns: info.times.ingest_ns,
                execute_ns: info.times.execute_ns,
                publish_ns: info.times.publish_ns,
            },
        })
    }
}
