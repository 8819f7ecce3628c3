//! The README and the pages of the book that have examples in Rust, so that they are compiled and run as doctests.
//! `tests/book.rs` says which pages are missing here.

/// Each item has a page as its documentation.
macro_rules! pages {
    ($($page:ident: $file:literal),* $(,)?) => {
        $(
            #[doc = include_str!(concat!("../", $file))]
            #[allow(dead_code)]
            struct $page;
        )*
    };
}

pages! {
    Readme: "README.md",
    StartRust: "book/src/start-rust.md",
    WhichSession: "book/src/which-session.md",
    Scenes: "book/src/scenes.md",
    Precision: "book/src/precision.md",
    Filters: "book/src/filters.md",
}
