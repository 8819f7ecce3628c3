//! A session as an engine, so that the conformance suite runs on every session backend too.

use pairmask::{ServedBy, Session, SessionBuilder};
use pairmask_core::Encoding;
use pairmask_core::engine::{
    CullError, CullInput, CullReport, Engine, EngineChoice, EngineName, ReplyBuffer,
};
use pairmask_core::mask::EncodingChoice;

use crate::frames::{Frames, report_of, served_by};

#[derive(Debug)]
pub struct SessionEngine {
    sessions: [Session; Encoding::ALL.len()],
    engine: EngineName,
    expected: ServedBy,
}

impl SessionEngine {
    /// Sessions of `builder`, with one engine: the plan might choose another for the second run of
    /// a frame, whose bytes would then differ. Every frame must be served by `expected`.
    pub fn new(builder: &SessionBuilder, engine: EngineName, expected: ServedBy) -> Self {
        let connect = |encoding| {
            let builder = builder.clone().engine(EngineChoice::Only(engine));
            builder.encoding(EncodingChoice::Only(encoding)).connect().expect("a session")
        };
        Self { sessions: Encoding::ALL.map(connect), engine, expected }
    }
}

impl Engine for SessionEngine {
    fn name(&self) -> EngineName {
        self.engine
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (boxes, _) = input.f32_boxes(self.engine)?;
        let session = &mut self.sessions[input.encoding.ordinal()];
        let mask = served_by(self.expected, || session.answer(boxes));
        assert_eq!(mask.info().engine, self.engine);
        assert_eq!(mask.pairs().count() as u64, mask.count(), "the decoder finds what was counted");
        mask.view().verify().expect("a mask by the rules");
        let extent = mask.shape().extent_words();
        reply.reserve(extent)?[..extent as usize]
            .copy_from_slice(&mask.reply_words()[..extent as usize]);
        Ok(report_of(&mask))
    }
}
