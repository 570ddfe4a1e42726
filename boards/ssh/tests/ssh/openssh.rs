//! OpenSSH's client.

use std::process::Stdio;

use mobgate_simulator::waiting::wait_for;

use crate::openssh_client::{NO_SESSION, begin, pipe, run, run_at_once};
use crate::server::Server;

#[test]
fn a_line_runs_by_key_or_password_and_its_exit_status_tells_whether_it_was_refused() {
    let server = Server::start(true);
    let (said, status) = run(&mut server.ssh.by_key(&[], "anna", "good"), "show users");
    assert!(said.contains("vera") && status == 0, "{status}: {said}");
    let (said, status) = run(&mut server.ssh.by_password(&[], "anna", "right"), "show users");
    assert!(said.contains("vera") && status == 0, "{status}: {said}");
    let (said, status) = run(&mut server.ssh.by_key(&[], "anna", "good"), "show prots");
    assert!(said.contains("error: line 1") && status == 1, "{status}: {said}");
    // A client offers all its keys, also those of other types.
    let files = ["other", "wrong"].map(|name| server.file(name).display().to_string());
    let options = ["-i", &files[0], "-i", &files[1]];
    assert_eq!(run(&mut server.ssh.by_key(&options, "anna", "good"), "show version").1, 0);
    let (said, status) = run(&mut server.ssh.by_key(&["-tt"], "anna", "good"), "show users");
    assert!(said.contains("vera") && said.contains("\r\n") && status == 0, "{status}: {said:?}");
    assert_eq!(server.logged_in(), 5);
}

#[test]
fn the_role_of_the_user_applies() {
    let server = Server::start(false);
    let (said, status) = run(&mut server.ssh.by_key(&[], "vera", "good"), "delete user anna");
    assert!(said.contains("needs the role engineer; yours is viewer") && status == 1, "{status}: {said}");
    let (said, status) = run(&mut server.ssh.by_key(&[], "vera", "good"), "show users");
    assert!(said.contains("anna") && status == 0, "{status}: {said}");
}

#[test]
fn a_wrong_key_a_wrong_password_and_an_unknown_user_are_refused_and_pause_the_address() {
    let server = Server::start(true);
    for mut command in [
        server.ssh.by_key(&[], "anna", "wrong"),
        server.ssh.by_key(&[], "anna", "other"),
        server.ssh.by_password(&[], "anna", "wrong-password"),
        server.ssh.by_password(&[], "nobody", "right"),
        server.ssh.by_key(&[], "nobody", "good"),
        server.ssh.by_key(&[], "a-name-that-is-longer-than-those-of-users", "good"),
    ] {
        let (said, status) = run(&mut command, "show ports");
        assert!(said.contains("Permission denied") && status == NO_SESSION, "{status}: {said}");
    }
    assert_eq!(server.logged_in(), 0);
    // Five failures begin a pause, which grows with each more; a key of another type is none. In it nobody gets in.
    wait_for("a pause", || {
        let options = ["-o", "NumberOfPasswordPrompts=9"];
        run(&mut server.ssh.by_password(&options, "anna", "wrong-password"), "show version");
        (run(&mut server.ssh.by_key(&[], "anna", "good"), "show version").1 == NO_SESSION).then_some(())
    });
    wait_for("the end of the pause", || {
        (run(&mut server.ssh.by_key(&[], "anna", "good"), "show version").1 == 0).then_some(())
    });
}

#[test]
fn a_board_without_passwords_says_so_and_takes_none() {
    let server = Server::start(false);
    let (said, status) = run(&mut server.ssh.by_password(&[], "anna", "right"), "show version");
    assert!(said.contains("Permission denied (publickey)") && status == NO_SESSION, "{status}: {said}");
}

#[test]
fn a_file_that_is_piped_in_is_carried_out_and_its_end_is_that_of_the_session() {
    let server = Server::start(false);
    let piped = |options: &[&str], text: &str| pipe(server.ssh.by_key(options, "anna", "good"), text);
    // The last line lacks its end.
    assert_eq!(
        piped(&[], "port P7 serial uart7 rtu client 9600 8N1\nroute P7 1 * * local\ndelete route 1\nsave"),
        ("saved\n".to_owned(), 0)
    );
    let (said, status) = piped(&[], "show version\nport P8 serial\nshow version\n");
    assert!(said.contains("error: line 2") && said.matches("mobgate 0.").count() == 2, "{said}");
    assert_eq!(status, 1);
    // More than all buffers on the way hold, both ways, and each line is refused. Keys are exchanged anew now and then.
    let nonsense = "nonsense, and a rest of the line that is as long as some lines are\n".repeat(12_000);
    let (said, status) = piped(&["-o", "RekeyLimit=100K"], &nonsense);
    assert_eq!((said.lines().count(), status), (12_000, 1));
}

#[test]
fn new_firmware_is_taken_as_a_file() {
    let server = Server::start(false);
    std::fs::write(server.file("image.mgu"), vec![0x1b; 300_000]).unwrap();
    let image = std::fs::File::open(server.file("image.mgu")).unwrap();
    let (said, status) = run(server.ssh.by_key(&[], "anna", "good").stdin(image), "update");
    assert!(said.contains("9.8.7 is complete and genuine") && status == 0, "{status}: {said}");
}

#[test]
fn an_interactive_session_edits_and_is_as_wide_as_the_terminal() {
    let server = Server::start(false);
    let (mut keyboard, end) = serial2::SerialPort::pair().unwrap();
    keyboard.set_read_timeout(std::time::Duration::from_secs(60)).unwrap();
    let name = rustix::termios::ttyname(&end, Vec::new()).unwrap().into_string().unwrap();
    let open = || Stdio::from(std::fs::File::options().read(true).write(true).open(&name).unwrap());
    let size = |columns| rustix::termios::Winsize { ws_row: 24, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
    rustix::termios::tcsetwinsize(&end, size(132)).unwrap();
    let ssh = server.ssh.by_key(&["-tt"], "anna", "good");
    let mut command = std::process::Command::new("setsid");
    command.args(["--ctty", "--wait", "ssh"]).args(ssh.get_args());
    let mut client = command.stdin(open()).stdout(open()).stderr(open()).spawn().unwrap();
    let mut screen = keyboard.try_clone().unwrap();
    let mut type_in = |keys: &str, until: &str| {
        keyboard.write_all(keys.as_bytes()).unwrap();
        let (mut said, mut byte) = (String::new(), [0]);
        while !said.ends_with(until) {
            std::io::Read::read_exact(&mut screen, &mut byte)
                .unwrap_or_else(|error| panic!("{error}: {said:?}"));
            said.push(char::from(byte[0]));
        }
        said
    };
    type_in("", "mobgate> ");
    // Tab completes.
    type_in("show vers\t\r", "mobgate 0.");
    type_in("", "mobgate> ");
    let wide = type_in("help\r", "mobgate> ");
    rustix::termios::tcsetwinsize(&end, size(60)).unwrap();
    // The client is told by a signal, which no response follows.
    wait_for("the new width", || {
        let narrow = type_in("help\r", "mobgate> ");
        (narrow.lines().count() > wide.lines().count()).then_some(())
    });
    type_in("nonsense\r", "error: ");
    type_in("exit\r", "exit\r\n");
    assert_eq!(client.wait().unwrap().code(), Some(0), "the user has seen which lines failed");
}

#[test]
fn eight_sessions_run_at_once() {
    let server = Server::start(false);
    run_at_once(8, || server.ssh.by_key(&[], "anna", "good"));
}

#[test]
fn nothing_but_sessions_is_served() {
    let server = Server::start(false);
    let (said, status) = run(&mut server.ssh.by_key(&["-s"], "anna", "good"), "sftp");
    assert!(said.contains("subsystem request failed") && status == NO_SESSION, "{status}: {said}");
    let forward = ["-o", "ExitOnForwardFailure=yes", "-R", "0:127.0.0.1:9"];
    let (said, status) = run(&mut server.ssh.by_key(&forward, "anna", "good"), "show version");
    assert!(said.contains("forwarding failed") && status == NO_SESSION, "{status}: {said}");
    for old in [
        "Ciphers=aes128-ctr",
        "KexAlgorithms=diffie-hellman-group14-sha256",
        "HostKeyAlgorithms=rsa-sha2-512",
    ] {
        let options = ["-o", old, "-o", "LogLevel=INFO"];
        let (said, status) = run(&mut server.ssh.by_key(&options, "anna", "good"), "show version");
        assert!(said.contains("Unable to negotiate") && status == NO_SESSION, "{old}: {status}: {said}");
    }
    // The name that the method had before, and its guess.
    let options = ["-o", "KexAlgorithms=curve25519-sha256@libssh.org"];
    assert_eq!(run(&mut server.ssh.by_key(&options, "anna", "good"), "show version").1, 0);
}

#[test]
fn a_session_that_its_client_leaves_is_over() {
    let server = Server::start(false);
    let (mut child, _to, _from) = begin(server.ssh.by_key(&[], "anna", "good"));
    let before = server.ended();
    child.kill().unwrap();
    child.wait().unwrap();
    wait_for("the session's end", || (server.ended() > before).then_some(()));
}
