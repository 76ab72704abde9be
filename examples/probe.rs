use overfly::bound::{self, graph::Graph, plan, routes::Routes};
use overfly::camera::Rig; use overfly::scene::*; use overfly::search::Problem; use overfly::session::Session; use overfly::settings::Settings; use overfly::stop::StopToken;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (seed, extent, buildings, w, rounds, rig): (u64, f64, u32, usize, u32, &str) = (a[1].parse().unwrap(), a[2].parse().unwrap(), a[3].parse().unwrap(), a[4].parse().unwrap(), a[5].parse().unwrap(), &a[6]);
    let scene = generate_block(&BlockSettings { seed, extent_m: [extent, extent], buildings, ..Default::default() });
    let mut settings = Settings::default(); settings.surface.samples = 150; settings.field.viewpoints = 200;
    if let Ok(g) = std::env::var("GOAL") { settings.coverage.goal_percent = g.parse().unwrap(); }
    if let Ok(g) = std::env::var("TH") { settings.coverage.threshold_percent = g.parse().unwrap(); }
    let stop = StopToken::default();
    let snapshot = Session::new(scene, std::sync::Arc::new(settings.clone()), &stop).unwrap().survey(&stop).unwrap().into_snapshot(&stop).unwrap();
    let problem = Problem::new(&snapshot, &settings, Rig::preset(rig).unwrap());
    println!("field viewpoints {} samples {} capturable {} sufficient {} radius {}", problem.field.viewpoints.len(), problem.field.samples.len(), problem.capturable, problem.sufficient, problem.field.facts.neighbour_radius_m);
    let t = std::time::Instant::now();
    let graph = Graph::of_problem(&problem, w, problem.field.facts.neighbour_radius_m, &stop).unwrap();
    println!("graph {} vertices {} edges, reachable {}, interior edges {} in {:?}", graph.positions_m.len(), graph.edges.len(), graph.reachable(), graph.edge_sights.iter().filter(|s| !s.is_empty()).count(), t.elapsed());
    let t = std::time::Instant::now();
    let routes = Routes::new(&graph);
    let walk = plan::shortest(&graph, &routes, rounds, 1, &stop);
    if let Some(walk) = &walk { println!("walk {} m, {} vertices, captured {} in {:?}", walk.length_um as f64 / 1e6, walk.vertices.len(), walk.captured, t.elapsed()); }
    let t = std::time::Instant::now();
    let bound = bound::lower_bound(&graph, &vec![2; graph.edges.len()], &stop, &mut |p| println!("{p:?}"));
    println!("bound {} m in {:?}; ratio {:?}", bound.bound_um as f64 / 1e6, t.elapsed(), walk.map(|w| w.length_um as f64 / bound.bound_um as f64));
}
