//! Boxes of a shared scene as an observer sees them: what changed, regardless of who wrote it.

use pairmask_core::pacing::Estimate;
use pairmask_core::scene::Scene as CoreScene;
use pairmask_core::units::BoxCount;
use pairmask_wire::{ObserveReply, ObserveRequest, Observed, ReplyFields, RequestHeader};

use super::backend::{Scene, SceneBackend};
use super::question::{Asked, Question};
use crate::session::core::Core;
use crate::session::error::Error;
use crate::session::link::Exchange;

impl Scene {
    /// Reports which boxes of a shared scene changed since this was asked last, regardless of who wrote them, and what they are now:
    /// for programs that record a scene, draw it, or bring it to another machine. It changes nothing, and needs no lease.
    ///
    /// A box that was removed is reported, also where its writer has ended. One that changed and came back to what it was
    /// may be reported, and so may one whose removal was. All boxes are reported the first time, and where the daemon has
    /// lost the scene. Boxes with margins are the inflated ones. The answer copies 56 bytes a box while ticks wait for it.
    ///
    /// ```no_run
    /// use pairmask::{SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().connect()?;
    /// let mut town = session.scene(SceneOptions::default().with_shared("town"))?;
    /// for observed in town.observe()?.boxes.iter().filter(|observed| observed.is_present()) {
    ///     println!("{} is at {:?}", observed.index, observed.aabb);
    /// }
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::NotShared`], among others.
    pub fn observe(&mut self) -> Result<Observed, Error> {
        match &mut self.backend {
            SceneBackend::Remote(scene) if scene.sharing().is_some() => {
                let observed = scene.ask(&Observe)?;
                scene.note_observed(observed.tick);
                Ok(observed)
            }
            _ => Err(Error::NotShared),
        }
    }
}

/// The question.
struct Observe;

impl Question for Observe {
    type Answer = Observed;

    fn is_empty(&self) -> bool {
        false
    }

    fn ask(&self, asked: Asked<'_>, estimate: &mut Estimate) -> Result<Observed, Error> {
        let Asked { core, link, scene, index_end, observed, .. } = asked;
        let shared = core.loan(link, 0)?;
        let request = ObserveRequest { scene, after: observed };
        let box_count = BoxCount::default();
        let fields =
            ReplyFields { client_token: link.token(), frame: core.next_frame(), box_count };
        let header = RequestHeader::observe_shared(fields.client_token, fields.frame, &request);
        let exchange = Exchange::begin(shared, &header)?;
        let answer = core.end(exchange, estimate.expect(0))?;
        let pages = answer.memory.pages();
        let reply = ObserveReply::parse(&answer.header, &fields, size_of_val(pages) as u64)?;
        Ok(reply.read(pages, index_end)?)
    }

    fn ask_here(&self, _: &Core, _: &mut CoreScene) -> Result<Observed, Error> {
        Err(Error::NotShared)
    }
}
