//! What an edit says, until it is answered.

use pairmask::filters::{FilterTable, Tag};
use pairmask::{Aabb, Margin};
use pairmask_core::scene::{Indices, Step, Tags};

/// What an edit says. Arrays of the program are read where they lie.
#[derive(Default)]
pub(super) struct Draft {
    /// Boxes that were set one by one.
    pub indices: Vec<u32>,
    /// One for each.
    pub boxes: Vec<Aabb>,
    /// One for each, where one was given.
    pub margins: Vec<Option<Margin>>,
    /// All else.
    pub given: Vec<Given>,
    /// The table of filters, which a step names.
    pub table: FilterTable,
}

/// A step of an edit.
pub(super) enum Given {
    /// One that borrows nothing of this library.
    Step(Step<'static>),
    /// The draft's table of filters.
    Table,
    /// Boxes with margins: one for all, or one for each.
    Margined { indices: Indices<'static>, boxes: &'static [Aabb], margins: Vec<Margin> },
}

impl Draft {
    /// Nothing said, with the memory of this.
    pub fn clear(&mut self) {
        self.indices.clear();
        self.boxes.clear();
        self.margins.clear();
        self.given.clear();
    }

    /// Sets one box.
    pub fn set(&mut self, index: u32, b: Aabb, margin: Option<Margin>) {
        self.indices.push(index);
        self.boxes.push(b);
        self.margins.push(margin);
    }

    /// Does a step.
    pub fn step(&mut self, step: Step<'static>) {
        self.given.push(Given::Step(step));
    }

    /// Gives boxes their tags.
    pub fn tag(&mut self, indices: Indices<'static>, tags: &'static [Tag]) {
        self.step(Step::Tag(Tags { indices, tags }));
    }
}
