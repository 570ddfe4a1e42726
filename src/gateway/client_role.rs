//! The role of the client behind a request.

use super::Gateway;
use super::connection::ConnectionState;
use crate::frame::{Origin, ReplyTo};
use crate::settings::ClientRole;

impl Gateway<'_> {
    /// The role of the client that `origin` names; none once another client has its connection.
    pub(crate) fn client_role(&self, origin: Origin) -> ClientRole {
        let ReplyTo::Connection(connection) = origin.reply_to else { return ClientRole::NONE };
        let role = |client: &mut ConnectionState| {
            Some(client.role).filter(|_| client.generation == origin.generation)
        };
        let connection = self.connections.get(usize::from(connection));
        connection.and_then(|connection| connection.update(role)).unwrap_or(ClientRole::NONE)
    }
}
