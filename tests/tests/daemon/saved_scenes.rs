//! Scenes that are saved and loaded have the boxes, flags, filters and lists that they had.

use pairmask::{Margin, Scene, SceneEdit, SceneFileError, SceneOptions};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{Edits, Grouped};

fn saved(scene: &mut Scene) -> Vec<u8> {
    let mut file = Vec::new();
    scene.save(&mut file).unwrap();
    file
}

fn pairs_of(scene: &mut Scene) -> Vec<Pair> {
    scene.edit().commit(Report::All).unwrap().pairs().to_vec()
}

/// Saves a scene after each of random edits, and loads it in both sessions. How many pairs were compared.
fn check(sessions: &mut [Session; 2], options: &SceneOptions, seed: u64, rounds: usize) -> usize {
    let mut edits = Edits::new(seed, 60);
    let mut scene = sessions[0].scene(options.clone()).unwrap();
    let mut found = 0;
    for _ in 0..rounds {
        let ops = edits.next_edit();
        let grouped = Grouped::of(&ops);
        let edit = grouped.steps().into_iter().fold(scene.edit(), SceneEdit::step);
        drop(edit.commit(Report::Changes).unwrap());
        let file = saved(&mut scene);
        let expected = pairs_of(&mut scene);
        found += expected.len();
        for session in &mut *sessions {
            let mut loaded = session.load_scene(options.clone(), &file[..]).unwrap();
            assert_eq!(loaded.len(), scene.len());
            // By their bits: a NaN is no other number than itself.
            let bits = |b: Aabb| <[f32; 6]>::from(b).map(f32::to_bits);
            let same = |index| {
                let is_marked_alike = loaded.user_data(index) == scene.user_data(index);
                loaded.get(index).map(bits) == scene.get(index).map(bits)
                    && (is_marked_alike || scene.get(index).is_none())
            };
            assert!((0..60).all(same));
            let answer = loaded.edit().commit(Report::Changes).unwrap();
            assert_eq!(answer.begun().to_vec(), expected);
            drop(answer);
            // What was saved tells which indices had a box once; what was loaded has none of those.
            let again = saved(&mut loaded);
            let mut loaded = session.load_scene(options.clone(), &again[..]).unwrap();
            assert_eq!(saved(&mut loaded), again);
        }
    }
    found
}

#[test]
fn a_loaded_scene_is_the_one_that_was_saved() {
    let daemon = TestDaemon::start(&["--gpu", "none"]);
    let mut sessions = [in_process(), daemon.connect()];
    let without = SceneOptions::default();
    let exact = without.clone().with_margin(Margin::new(0.7).unwrap());
    let (seeds, mut found) = (tier::nightly_or(60, 3), 0);
    for seed in 0..seeds {
        found += check(&mut sessions, &without, seed, 30);
        sessions.reverse();
        found += check(&mut sessions, &exact, seed, 30);
    }
    // As many as there were edits.
    assert!(found > 60 * seeds as usize, "{found}");
}

#[test]
fn what_cannot_be_loaded_is_a_typed_error() {
    let mut session = in_process();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    drop(scene.edit().set(70, at(0.0)).set(9, at(0.5)).commit(Report::Nothing).unwrap());
    let file = saved(&mut scene);
    let mut load = |options: &SceneOptions, file: &[u8]| session.load_scene(options.clone(), file);
    let options = SceneOptions::default();
    assert!(load(&options, &file).is_ok());
    let truncated = load(&options, &file[..file.len() - 1]);
    assert!(matches!(truncated, Err(Error::SceneFile(SceneFileError::Truncated))));
    let other = load(&options, &[7; 300]);
    assert!(matches!(other, Err(Error::SceneFile(SceneFileError::NotAScene))));
    // An index beyond what the scene may hold.
    assert!(matches!(load(&options.with_most_boxes(70), &file), Err(Error::Edit(_))));
    // Any byte that is another one: an error, or another scene.
    for at in 0..file.len() {
        let mut forged = file.clone();
        forged[at] ^= 0x11;
        if let Ok(mut loaded) = load(&SceneOptions::default().with_most_boxes(1_000), &forged) {
            let _ = pairs_of(&mut loaded);
        }
    }
}
