//! The currently available objects: those of the device's table, and those of the application's modules.

use crate::application::Application;
use crate::device::Device;
use crate::object::Object;

/// Looks objects up.
pub struct Catalogue<'a, A> {
    /// The table.
    pub device: &'static Device,
    /// The application with the other objects.
    pub application: &'a A,
}

impl<A: Application> Catalogue<'_, A> {
    /// The object at `index`.
    pub fn object(&self, index: u16) -> Option<Object> {
        self.device.object(index).copied().or_else(|| self.application.object(index))
    }

    /// All objects from `index` on, in index order.
    pub fn objects_from(&self, index: u16) -> impl Iterator<Item = Object> {
        let mut next = Some(index);
        core::iter::from_fn(move || {
            let from = next?;
            let listed = self.device.objects.partition_point(|object| object.index < from);
            let listed = self.device.objects.get(listed).map(|object| object.index);
            let found = listed.into_iter().chain(self.application.next_object(from)).min()?;
            next = found.checked_add(1);
            self.object(found)
        })
    }
}
