//! What a scene is set beside: whole frames, or another library's broad phase in the same state.

use std::error::Error;

use pairmask::{Aabb, Session};
use pairmask_tests::measure::iterate;
#[cfg(feature = "peers")]
use pairmask_tests::peers::parry_scene::ParryWay;

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum PeerName {
    /// A frame of the same session
    #[value(alias = "frame")]
    WholeFrame,
    #[cfg(feature = "peers")]
    Rapier,
    #[cfg(feature = "peers")]
    Parry,
    #[cfg(feature = "peers")]
    ParryQueries,
}

type Done = Result<(), Box<dyn Error>>;

pub trait Peer {
    /// Makes the same change: boxes that moved are given, and what it reports is kept or iterated over.
    fn change(&mut self, session: &mut Session, boxes: &[Aabb], moved: &[u32]) -> Done;

    /// How many pairs it keeps, if it keeps them.
    fn pairs(&mut self, boxes: &[Aabb]) -> Result<Option<u64>, Box<dyn Error>>;
}

#[cfg_attr(not(feature = "peers"), expect(clippy::unnecessary_wraps))]
pub fn peer(
    name: PeerName,
    #[cfg_attr(not(feature = "peers"), expect(unused))] boxes: &[Aabb],
) -> Result<Box<dyn Peer>, Box<dyn Error>> {
    Ok(match name {
        PeerName::WholeFrame => Box::new(WholeFrame),
        #[cfg(feature = "peers")]
        PeerName::Rapier => Box::new(others::rapier(boxes)?),
        #[cfg(feature = "peers")]
        PeerName::Parry => Box::new(others::parry(boxes, ParryWay::Changes)),
        #[cfg(feature = "peers")]
        PeerName::ParryQueries => Box::new(others::parry(boxes, ParryWay::Queries)),
    })
}

struct WholeFrame;

impl Peer for WholeFrame {
    fn change(&mut self, session: &mut Session, boxes: &[Aabb], _: &[u32]) -> Done {
        whole_frame(session, boxes).map(drop)
    }

    fn pairs(&mut self, _: &[Aabb]) -> Result<Option<u64>, Box<dyn Error>> {
        Ok(None)
    }
}

#[cfg(feature = "peers")]
mod others {
    use std::hint::black_box;

    use super::{Aabb, Done, Error, ParryWay, Peer, Session};
    use pairmask_tests::peers::contender::{Contender, ContenderError};
    use pairmask_tests::peers::parry_scene::ParryScene;
    use pairmask_tests::peers::rapier::Rapier;

    pub fn rapier(boxes: &[Aabb]) -> Result<Rapier, ContenderError> {
        let mut rapier = Rapier::new(boxes.len());
        rapier.change((0..).zip(boxes))?;
        Ok(rapier)
    }

    pub fn parry(boxes: &[Aabb], way: ParryWay) -> ParryScene {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        ParryScene::new(boxes, way, threads)
    }

    impl Peer for Rapier {
        fn change(&mut self, _: &mut Session, boxes: &[Aabb], moved: &[u32]) -> Done {
            let moved = moved.iter().map(|i| (*i, &boxes[*i as usize]));
            black_box(Rapier::change(self, moved)?);
            Ok(())
        }

        fn pairs(&mut self, boxes: &[Aabb]) -> Result<Option<u64>, Box<dyn Error>> {
            Ok(Some(Contender::pairs(self, boxes)?.len() as u64))
        }
    }

    impl Peer for ParryScene {
        fn change(&mut self, _: &mut Session, boxes: &[Aabb], moved: &[u32]) -> Done {
            black_box(ParryScene::change(self, moved, boxes)?);
            Ok(())
        }

        fn pairs(&mut self, _: &[Aabb]) -> Result<Option<u64>, Box<dyn Error>> {
            Ok(Some(ParryScene::pairs(self).len() as u64))
        }
    }
}

/// A whole frame, every pair iterated over: how many.
pub fn whole_frame(session: &mut Session, boxes: &[Aabb]) -> Result<u64, Box<dyn Error>> {
    let mut frame = session.frame(boxes.len())?;
    frame.boxes_mut().copy_from_slice(boxes);
    let mask = frame.submit()?.wait()?;
    Ok(iterate(|each| mask.for_each_slice(each)))
}
