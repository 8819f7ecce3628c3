//! The crates of the library are layers: no module uses one that uses it, by whatever way.

use std::path::Path;

use pairmask_tests::module_graph::ModuleGraph;

fn graph_of(src: &str) -> ModuleGraph {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(src);
    ModuleGraph::of_crate(&src).expect("the source of the crate")
}

#[test]
fn no_modules_of_the_library_use_each_other_in_a_circle() {
    for (src, least) in
        [("client-lib/core/src", 12), ("client-lib/wire/src", 6), ("client-lib/transport/src", 10)]
    {
        let graph = graph_of(src);
        assert!(
            graph.len() >= least,
            "{src} has {} modules: read from the wrong place?",
            graph.len()
        );
        let layers = graph.layers().unwrap_or_else(|stuck| panic!("{src}: a circle in {stuck:?}"));
        assert_eq!(layers.len(), graph.len());
    }
}

#[test]
fn a_circle_is_found() {
    let mut graph = ModuleGraph::default();
    graph.add("low", "use std::fmt; // crate::high");
    graph.add(
        "middle",
        "use crate::low::Thing;\n#[cfg(test)]\nmod tests { use crate::high::Other; }",
    );
    graph.add("high", "use crate::{low::{A, B}, middle};\nfn f() { crate::low::g(); }");
    assert_eq!(graph.layers(), Ok(vec!["low", "middle", "high"]));
    graph.add("low", "fn f() { crate::high::g(); }");
    assert_eq!(graph.layers(), Err(vec!["high", "low", "middle"]));
}
