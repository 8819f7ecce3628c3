//! A saved scene.

use pairmask_core::scene::{Edit, Report, Scene, SceneOptions};
use pairmask_wire::{SceneFile, write_scene};

/// Indices of a scene are below this.
const MOST_BOXES: u32 = 1 << 10;

pub fn decode(data: &[u8]) {
    let Some(scene) = load(data) else { return };
    // What is saved is the scene, however the file said it: a file may name filters that let all meet, and the second
    // one says nothing of them.
    let first = save(&scene);
    let again = load(&first).expect("a whole scene");
    let second = save(&again);
    let last = load(&second).expect("a whole scene");
    assert_eq!(second, save(&last), "saved, read, and saved again");
    for loaded in [&again, &last] {
        assert_eq!(loaded.reported().pairs(), scene.reported().pairs());
    }
}

/// The scene of a file, with all its pairs reported; `None` where no scene is as the file says.
fn load(mut bytes: &[u8]) -> Option<Scene> {
    let file = SceneFile::read(&mut bytes, MOST_BOXES).ok()?;
    let steps = file.steps().expect("it was checked");
    let mut scene = Scene::new(SceneOptions::default().with_most_boxes(MOST_BOXES));
    scene.edit(Edit { steps: &steps }, Report::All).is_ok().then_some(scene)
}

fn save(scene: &Scene) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_scene(Edit { steps: &scene.whole().steps() }, &mut bytes).expect("memory");
    bytes
}
