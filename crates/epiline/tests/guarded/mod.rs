//! Outputs of kernels between cells that they may not touch.

/// Cells on either side of an output that no kernel may touch.
const GUARD: usize = 70;

/// A slice between guard cells.
pub struct Guarded<T> {
    cells: Vec<T>,
    canary: T,
}

impl<T: Copy + PartialEq + std::fmt::Debug> Guarded<T> {
    /// Around a copy of the content.
    pub fn of(content: &[T], canary: T) -> Self {
        let mut cells = vec![canary; content.len() + 2 * GUARD];
        cells[GUARD..GUARD + content.len()].copy_from_slice(content);
        Self { cells, canary }
    }

    /// What a kernel is given.
    pub fn inside(&mut self) -> &mut [T] {
        let end = self.cells.len() - GUARD;
        &mut self.cells[GUARD..end]
    }

    /// The content, after a look at the guards.
    pub fn checked(&self, name: &str) -> Vec<T> {
        let end = self.cells.len() - GUARD;
        let guards = self.cells[..GUARD].iter().chain(&self.cells[end..]);
        assert!(guards.into_iter().all(|&cell| cell == self.canary), "{name}: a guard cell was written");
        self.cells[GUARD..end].to_vec()
    }
}
