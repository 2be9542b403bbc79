//! Islands: sets of bodies that contacts, bonds or pair forces join, so that they are integrated together.

/// For each body, its island: sorted indices, itself included. Only the methods of this file change them.
pub(in crate::world) struct Islands {
    of: Vec<Vec<usize>>,
}

impl Islands {
    /// Each body is an island of its own.
    pub fn apart(bodies: usize) -> Self {
        Islands { of: (0..bodies).map(|i| vec![i]).collect() }
    }

    pub fn of(&self, body: usize) -> &[usize] {
        &self.of[body]
    }

    /// Each of these bodies becomes an island of its own.
    pub fn separate(&mut self, bodies: impl Iterator<Item = usize>) {
        for i in bodies {
            self.of[i].clear();
            self.of[i].push(i);
        }
    }

    /// These bodies (sorted) become one island.
    pub fn unite(&mut self, bodies: &[usize]) {
        for &i in bodies {
            self.of[i].clear();
            self.of[i].extend_from_slice(bodies);
        }
    }

    /// The islands of two bodies become one; walls join none.
    pub fn join(&mut self, a: usize, b: usize) {
        if b >= self.of.len() || self.of[a].contains(&b) {
            return;
        }
        let mut all = [self.of[a].as_slice(), self.of[b].as_slice()].concat();
        all.sort_unstable();
        self.unite(&all);
    }

    /// The bodies of the islands of `a` and `b`.
    pub fn union(&self, a: usize, b: usize) -> Vec<usize> {
        let mut all = self.of[a].clone();
        if let Some(other) = self.of.get(b) {
            all.extend(other.iter().filter(|j| !self.of[a].contains(j)));
        }
        all
    }

    /// Whether the two are bodies of one island.
    pub fn same(&self, a: usize, b: usize) -> bool {
        self.of[a].contains(&b)
    }
}
