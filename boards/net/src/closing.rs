//! How a TCP connection is ended.

use embassy_net::tcp::TcpSocket;
use embassy_time::{Duration, with_timeout};

/// Time that an orderly end of a connection may take.
const CLOSE_MAX: Duration = Duration::from_millis(250);
/// Time in which a reset leaves, if the network takes it at all.
const RESET_MAX: Duration = Duration::from_millis(20);

/// Ends a connection: in an orderly way if the peer agrees in time, else by a reset.
pub(crate) async fn end(socket: &mut TcpSocket<'static>) {
    socket.close();
    let orderly = async {
        // What the peer still sends is read until it ends its side, too: unread bytes would become a reset, which may
        // overtake the last response.
        let mut rest = [0; 64];
        while socket.read(&mut rest).await.is_ok_and(|count| count > 0) {}
        socket.flush().await
    };
    if !matches!(with_timeout(CLOSE_MAX, orderly).await, Ok(Ok(()))) {
        socket.abort();
        // A link that is down takes no reset: the peer finds out by itself.
        let _ = with_timeout(RESET_MAX, socket.flush()).await;
    }
}
