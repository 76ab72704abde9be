//! Minimum cuts: the blocking flows of Dinic.

/// A network with whole capacities.
#[derive(Clone, Debug, Default)]
pub struct Network {
    /// By node, its arcs.
    arcs_of: Vec<Vec<usize>>,
    /// Arc and opposite arc stand side by side.
    heads: Vec<usize>,
    room: Vec<i64>,
}

impl Network {
    pub fn new(nodes: usize) -> Self {
        Self { arcs_of: vec![Vec::new(); nodes], heads: Vec::new(), room: Vec::new() }
    }

    /// Joins `a` and `b` with so much capacity from `a` to `b` and so much back.
    pub fn join(&mut self, a: usize, b: usize, there: i64, back: i64) {
        for (from, to, room) in [(a, b, there), (b, a, back)] {
            self.arcs_of[from].push(self.heads.len());
            self.heads.push(to);
            self.room.push(room);
        }
    }

    /// Sends as much as possible, but no more than `enough`, from `source` to `sink`. Returns how much, and which nodes lie on the source's side of a
    /// smallest cut; that side means nothing when it was enough.
    pub fn cut(&mut self, source: usize, sink: usize, enough: i64) -> (i64, Vec<bool>) {
        let mut sent = 0;
        loop {
            let levels = self.levels(source);
            if levels[sink] == u32::MAX || sent >= enough {
                return (sent, levels.into_iter().map(|level| level != u32::MAX).collect());
            }
            let mut next = vec![0; self.arcs_of.len()];
            while sent < enough {
                let more = self.push(source, sink, enough - sent, &levels, &mut next);
                if more == 0 {
                    break;
                }
                sent += more;
            }
        }
    }

    /// After [`Network::cut`]: the nodes from which more could still be sent to `sink`, which is the sink's side of a smallest cut too.
    pub fn sink_side(&self, sink: usize) -> Vec<bool> {
        let mut reaches = vec![false; self.arcs_of.len()];
        reaches[sink] = true;
        let mut open = vec![sink];
        while let Some(node) = open.pop() {
            for &arc in &self.arcs_of[node] {
                let from = self.heads[arc];
                if self.room[arc ^ 1] > 0 && !reaches[from] {
                    reaches[from] = true;
                    open.push(from);
                }
            }
        }
        reaches
    }

    fn levels(&self, source: usize) -> Vec<u32> {
        let mut levels = vec![u32::MAX; self.arcs_of.len()];
        levels[source] = 0;
        let mut queue = vec![source];
        let mut head = 0;
        while let Some(&node) = queue.get(head) {
            head += 1;
            for &arc in &self.arcs_of[node] {
                let to = self.heads[arc];
                if self.room[arc] > 0 && levels[to] == u32::MAX {
                    levels[to] = levels[node] + 1;
                    queue.push(to);
                }
            }
        }
        levels
    }

    /// One path in the levels; its depth is at most the number of nodes.
    fn push(&mut self, node: usize, sink: usize, most: i64, levels: &[u32], next: &mut [usize]) -> i64 {
        if node == sink {
            return most;
        }
        while let Some(&arc) = self.arcs_of[node].get(next[node]) {
            let to = self.heads[arc];
            if self.room[arc] > 0 && levels[to] == levels[node] + 1 {
                let sent = self.push(to, sink, most.min(self.room[arc]), levels, next);
                if sent > 0 {
                    self.room[arc] -= sent;
                    self.room[arc ^ 1] += sent;
                    return sent;
                }
            }
            next[node] += 1;
        }
        0
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_flow_is_the_smallest_of_all_cuts(arcs in proptest::collection::vec((0usize..6, 0usize..6, 0i64..9, 0i64..9), 0..15)) {
            let mut network = Network::new(6);
            arcs.iter().for_each(|&(a, b, there, back)| network.join(a, b, there, back));
            let weight = |side: &dyn Fn(usize) -> bool| -> i64 {
                arcs.iter().map(|&(a, b, there, back)| match (side(a), side(b)) {
                    (true, false) => there,
                    (false, true) => back,
                    _ => 0,
                }).sum()
            };
            let smallest = (0..16).map(|inner: usize| weight(&|v| v == 0 || (v < 5 && inner >> (v - 1) & 1 == 1))).min();
            let (sent, side) = network.cut(0, 5, i64::MAX);
            prop_assert_eq!(Some(sent), smallest);
            prop_assert!(side[0] && !side[5]);
            prop_assert_eq!(weight(&|v| side[v]), sent);
            let sink_side = network.sink_side(5);
            prop_assert!(sink_side[5] && !sink_side[0]);
            prop_assert_eq!(weight(&|v| !sink_side[v]), sent);
        }
    }
}
