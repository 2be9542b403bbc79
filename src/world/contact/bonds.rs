//! Bonds between bodies that stick together, and the clusters that they form.

use crate::num::{Real, Vec2};
use crate::world::motion::kinematics::IslandVec;

/// Bodies `a` and `b` stick together.
#[derive(Clone, Copy)]
pub(in crate::world) struct Bond<T> {
    pub a: usize,
    pub b: usize,
    /// Unit normal from a to b, in the frame of a.
    pub normal: Vec2<T>,
    /// Inverse of the pull that separates them (1/N).
    pub inverse_strength: T,
}

/// All bonds of a simulation. Only the methods of this file change them.
pub(in crate::world) struct Bonds<T> {
    bonds: Vec<Bond<T>>,
    /// Bodies that bonds join into one rigid body, each sorted.
    clusters: Vec<Vec<usize>>,
}

impl<T: Real> Bonds<T> {
    pub fn new() -> Self {
        Bonds { bonds: vec![], clusters: vec![] }
    }

    pub fn is_empty(&self) -> bool {
        self.bonds.is_empty()
    }

    pub fn iter(&self) -> impl Iterator<Item = &Bond<T>> {
        self.bonds.iter()
    }

    pub fn add(&mut self, bond: Bond<T>) {
        self.bonds.push(bond);
        self.find_clusters();
    }

    pub fn remove(&mut self, index: usize) {
        self.bonds.remove(index);
        self.find_clusters();
    }

    fn find_clusters(&mut self) {
        self.clusters.clear();
        for Bond { a, b, .. } in &self.bonds {
            let (near, far): (Vec<_>, Vec<_>) =
                self.clusters.drain(..).partition(|c: &Vec<usize>| c.contains(a) || c.contains(b));
            let mut joined = near.concat();
            joined.extend([a, b]);
            joined.sort_unstable();
            joined.dedup();
            self.clusters = far;
            self.clusters.push(joined);
        }
    }

    /// The bodies that stick together with body `i`, itself included, if any do.
    pub fn cluster(&self, i: usize) -> Option<&[usize]> {
        self.clusters.iter().find(|c| c.contains(&i)).map(Vec::as_slice)
    }

    /// Body `i` and all that stick to it.
    pub fn members(&self, i: usize) -> IslandVec<usize> {
        self.cluster(i).map_or_else(|| IslandVec::from_elem(i, 1), IslandVec::from_slice)
    }

    pub fn same_cluster(&self, a: usize, b: usize) -> bool {
        self.cluster(a).is_some_and(|c| c.contains(&b))
    }

    /// The clusters within an island, as positions in it.
    pub fn clusters_of(&self, island: &[usize]) -> impl Iterator<Item = IslandVec<usize>> {
        let own = self.clusters.iter().filter(|c| island.contains(&c[0]));
        own.map(|c| c.iter().filter_map(|j| island.iter().position(|i| i == j)).collect())
    }

    /// The bodies on b's side of a bond.
    pub fn beyond(&self, bond: &Bond<T>) -> Vec<usize> {
        let mut side = vec![bond.b];
        let mut next = 0;
        while let Some(&j) = side.get(next) {
            next += 1;
            let others = self.bonds.iter().filter(|o| (o.a, o.b) != (bond.a, bond.b));
            for (near, far) in others.flat_map(|o| [(o.a, o.b), (o.b, o.a)]) {
                if near == j && !side.contains(&far) {
                    side.push(far);
                }
            }
        }
        side
    }
}
