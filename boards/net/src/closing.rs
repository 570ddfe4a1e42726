//! Closes a TCP connection.

use embassy_net::tcp::TcpSocket;
use embassy_time::{Duration, with_timeout};

/// Time limit of an orderly close.
const CLOSE_MAX: Duration = Duration::from_millis(250);
/// Time for a reset to leave, if the network accepts it at all.
const RESET_MAX: Duration = Duration::from_millis(20);

/// Closes a connection: orderly if the peer agrees in time, else by a reset.
pub(crate) async fn end(socket: &mut TcpSocket<'static>) {
    socket.close();
    let orderly = async {
        // Read until the peer closes its side, too: unread bytes would cause a reset, which may overtake the last response.
        let mut rest = [0; 64];
        while socket.read(&mut rest).await.is_ok_and(|count| count > 0) {}
        socket.flush().await
    };
    if !matches!(with_timeout(CLOSE_MAX, orderly).await, Ok(Ok(()))) {
        socket.abort();
        // No reset leaves while the link is down: the peer times out by itself.
        let _ = with_timeout(RESET_MAX, socket.flush()).await;
    }
}
