//! The pages of the book that have examples in Rust, so that they are compiled and run as doctests.
//! `tests/book.rs` says which pages are missing here.

/// Each item has a page as its documentation.
macro_rules! pages {
    ($($page:ident: $file:literal),* $(,)?) => {
        $(
            #[doc = include_str!(concat!("../book/src/", $file))]
            #[allow(dead_code)]
            struct $page;
        )*
    };
}

pages! {
    StartRust: "start-rust.md",
    WhichSession: "which-session.md",
    Scenes: "scenes.md",
    Precision: "precision.md",
    Filters: "filters.md",
}
