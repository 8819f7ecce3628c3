//! A frame of the simulation: boxes move, the scene reports what changed, contacts push.

use pairmask::{Error, Report, Scene, SceneOptions, ServedBy, Session};

use crate::contacts::Contacts;
use crate::world::World;

/// A world, its boxes in a scene, and the contacts of its overlapping pairs.
pub struct Simulation {
    pub world: World,
    pub scene: Scene,
    /// Contacts with their axes.
    pub contacts: Contacts<usize>,
}

/// What a frame took.
pub struct Frame {
    pub served_by: ServedBy,
    /// Boxes that were sent.
    pub sent: usize,
}

impl Simulation {
    /// Sends all boxes. They are at the same indices in the world and in the scene.
    pub fn new(session: &mut Session, world: World) -> Result<Self, Error> {
        let mut scene = session.scene(SceneOptions::default())?;
        let (boxes, statics) = (world.boxes(), world.statics());
        let edit = scene.edit().set_all(0..boxes.len() as u32, &boxes);
        // Floor and walls overlap at the edges, which is no contact: two static boxes are no pair.
        drop(edit.make_all_static(statics, true).commit(Report::Nothing)?);
        Ok(Self { world, scene, contacts: Contacts::new() })
    }

    /// Advances the world by one frame.
    pub fn step(&mut self) -> Result<Frame, Error> {
        let Self { world, scene, contacts } = self;
        world.fall();

        let (indices, boxes) = world.moved();
        let (sent, edit) = (indices.len(), scene.edit().set_all(indices, boxes));
        let answer = edit.commit(Report::Changes)?;
        let changed = contacts.update(&answer, |pair| world.contact_axis(pair));

        world.wake(&changed);
        world.push_apart(contacts);
        Ok(Frame { served_by: answer.served_by(), sent })
    }
}
