//! The console where the program offers it: standard input, a terminal, a socket, a TCP port.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::process::Stdio;
use std::time::Instant;

use rustix::process::Signal;

use common::{
    PATIENCE, Program, USER, converse, free_port, listening, mobgate, output, refusal, wait_for, with_console,
};

mod common;

#[test]
fn several_sessions_at_once_see_the_same_settings() {
    let program = with_console("port P502 tcp server {port}\n");
    let (mut one, mut two) = (program.session(), program.session());
    converse(&mut one, "port P7 serial /dev/ttyS7 rtu client 9600 8N1\nshow config\n", "ttyS7");
    converse(&mut two, "show config\n", "ttyS7");
}

#[test]
fn the_program_is_up_since_it_was_started_and_not_since_the_machine_was() {
    let before = Instant::now();
    let program = with_console("port P502 tcp server {port}\n");
    let said = converse(&mut program.session(), "show version\n", "\n");
    let up = said.trim_end().rsplit_once(", up ").and_then(|(_, up)| up.strip_suffix('s')).unwrap();
    assert!(up.parse::<u64>().unwrap() <= before.elapsed().as_secs(), "{said}");
}

#[test]
fn save_writes_the_file_that_check_finds_good() {
    let program = with_console("port P502 tcp server {port}\n");
    let mut console = program.session();
    console
        .write_all(b"port P7 serial /dev/ttyS7 rtu client 9600 8N1\nroute P502 1-9 * * P7\nsave\n")
        .unwrap();
    wait_for("the file", || fs::read_to_string(program.config()).unwrap().contains("ttyS7").then_some(()));
    let checked = output(&["--check", program.config().to_str().unwrap()]);
    assert!(checked.status.success(), "{checked:?}");
}

#[test]
fn the_demo_cannot_save_and_says_how_it_could() {
    let program = Program::demo_with_console();
    converse(&mut program.session(), "save\n", "start with --config FILE");
}

#[test]
fn a_scan_of_the_demo_finds_its_three_devices_the_slow_one_too() {
    let program = Program::demo_with_console();
    let said = converse(&mut program.session(), "scan bus 19200 units 1-5\n", "units 1,2,3\n");
    assert!(said.contains("3 units found in ") && said.contains("edit port bus 19200 8E1"), "{said}");
}

#[test]
fn reboot_starts_the_program_again_with_the_saved_settings() {
    let mut program = with_console("port P502 tcp server {port}\n");
    let new = free_port();
    fs::write(program.config(), format!("port P502 tcp server {new}\n")).unwrap();
    converse(&mut program.session(), "reboot\n", "starting again");
    wait_for("the new port", || TcpStream::connect((Ipv4Addr::LOCALHOST, new)).ok());
    assert!(program.is_running(), "the process stays the same");
    converse(&mut program.session(), "show version\n", "mobgate 0.");
    program.signal(Signal::TERM);
    assert_eq!(program.wait().code(), Some(0));
}

#[test]
fn a_taken_console_port_ends_the_start() {
    let (_taken, at) = listening();
    let (at, listen) = (at.to_string(), free_port().to_string());
    assert!(refusal(&["--listen", &listen, "--console", &at, "--socket", "off"]).contains("console"));
}

#[test]
fn lines_of_a_file_on_standard_input_are_carried_out_and_the_gateway_goes_on() {
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let lines = folder.path().join("lines");
    // The last line lacks its end.
    fs::write(&lines, format!("port P502 tcp server 127.0.0.1:{port}\nshow config")).unwrap();
    fs::write(folder.path().join("mobgate.conf"), "").unwrap();
    let mut command = mobgate();
    command.arg("--config").arg(folder.path().join("mobgate.conf")).args(["--socket", "off"]);
    let mut program = Program::start(command.stdin(File::open(lines).unwrap()), folder, port);
    program.logs(&format!("port P502 tcp server 127.0.0.1:{port}"));
    assert!(program.is_running());
}

/// The program with a TCP server and a console on TCP, which is told here.
fn on_tcp() -> (Program, u16) {
    let console = free_port();
    let settings =
        format!("port P502 tcp server 127.0.0.1:{{port}}\nroute P502 1 * * local readonly\n{USER}");
    let at = format!("127.0.0.1:{console}");
    let options = ["--config", "{folder}/mobgate.conf", "--socket", "off", "--console", &at];
    (Program::with(&settings, &options), console)
}

/// A session at its TCP port.
fn tcp_session(console: u16) -> TcpStream {
    let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, console)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

#[test]
fn what_a_browser_sends_to_the_tcp_console_is_not_carried_out() {
    let (program, console) = on_tcp();
    let body = "delete route 1\r\nsave\r\n";
    let post =
        format!("POST / HTTP/1.1\r\nHost: 127.0.0.1:{console}\r\nContent-Type: text/plain\r\n\r\n{body}");
    let tls = [&b"\x16\x03\x01\x02\x00\x01\n"[..], body.as_bytes()].concat();
    let telnet = [&b"\xff\xfd\x03\n"[..], body.as_bytes()].concat();
    for (bytes, logged) in [(post.as_bytes(), "this is HTTP"), (&tls, "this is TLS"), (&telnet, "telnet")] {
        let mut stream = tcp_session(console);
        stream.write_all(bytes).unwrap();
        let mut response = Vec::new();
        stream.read_to_end(&mut response).unwrap();
        assert_eq!(
            String::from_utf8_lossy(&response),
            "user: ",
            "nothing more is said, and the session ends"
        );
        program.logs(logged);
    }
    converse(&mut tcp_session(console), "anna\nlet me in\nshow routes\n", "readonly");
    program.logs("audit: anna@127.0.0.1: logged in as engineer");
    converse(&mut tcp_session(console), "anna\nlet me out\n", "no such user, or another password");
    program.logs("audit: 127.0.0.1: a wrong password for anna");
    assert!(fs::read_to_string(program.config()).unwrap().contains("readonly"));
}

/// The TCP ports that the program listens on.
fn tcp_listeners(program: &Program) -> usize {
    let sockets: Vec<String> = fs::read_dir(format!("/proc/{}/fd", program.id()))
        .unwrap()
        .filter_map(|entry| Some(fs::read_link(entry.ok()?.path()).ok()?.to_str()?.to_owned()))
        .filter_map(|target| Some(target.strip_prefix("socket:[")?.trim_end_matches(']').to_owned()))
        .collect();
    let tables = ["tcp", "tcp6"].map(|name| fs::read_to_string(format!("/proc/{}/net/{name}", program.id())));
    let is_own_listener = |line: &&str| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        // State 0A listens; the tenth field is the inode.
        fields[3] == "0A" && sockets.iter().any(|inode| inode == fields[9])
    };
    tables.iter().flatten().map(|table| table.lines().skip(1).filter(is_own_listener).count()).sum()
}

#[test]
fn a_password_set_at_the_local_console_is_saved_as_its_hash_and_opens_the_tcp_console() {
    let (program, console) = on_tcp();
    let lines = "user bert role operator\npassword bert\nbattery staple\nsave\n";
    converse(&mut tcp_session(console), &("anna\nlet me in\n".to_owned() + lines), "saved");
    let saved = fs::read_to_string(program.config()).unwrap();
    assert!(saved.contains("user bert role operator password \"$argon2id$v=19$m=19456,t=2,p=1$"), "{saved}");
    assert!(!saved.contains("battery"), "{saved}");
    converse(
        &mut tcp_session(console),
        "bert\nbattery staple\nsave\n",
        "needs the role engineer; yours is operator",
    );
    converse(&mut tcp_session(console), "bert\nbattery stapler\n", "no such user, or another password");
}

#[test]
fn the_tcp_console_is_for_this_machine_only() {
    let refused = output(&["--console", "0.0.0.0:5026"]);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(said.contains("it is not encrypted: on this machine only, such as 127.0.0.1:5026"), "{said}");
}

#[test]
fn the_console_is_on_no_tcp_port_unless_one_is_named() {
    assert_eq!(tcp_listeners(&Program::configured("port P502 tcp server {port}\n")), 1);
    assert_eq!(tcp_listeners(&on_tcp().0), 2);
}

#[test]
fn a_newcomer_gets_the_place_of_the_session_that_is_idle_for_longest_which_is_told() {
    let program = with_console("port P502 tcp server {port}\n");
    let mut sessions: Vec<_> = (0..4).map(|_| program.session()).collect();
    // Each has its place when it has its response; then the first one is used again.
    for n in [0, 1, 2, 3, 0] {
        converse(&mut sessions[n], "show version\n", "mobgate 0.");
    }
    converse(&mut program.session(), "show version\n", "mobgate 0.");
    let mut said = String::new();
    sessions[1].read_to_string(&mut said).unwrap();
    assert!(said.contains("session ended: 4 at a time"), "{said:?}");
    for n in [0, 2] {
        converse(&mut sessions[n], "show version\n", "mobgate 0.");
    }
    program.logs("ended: 4 at a time");
}

#[test]
fn a_second_gateway_finds_the_socket_in_use_and_one_that_was_killed_leaves_it_free() {
    let program = with_console("port P502 tcp server {port}\n");
    let socket = program.socket();
    let said = refusal(&["--listen", &free_port().to_string(), "--socket", socket.to_str().unwrap()]);
    assert!(said.contains("in use by another gateway; --socket PATH names another one"), "{said}");

    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let path = folder.path().join("console");
    let start = |folder| {
        let mut command = mobgate();
        command.args(["--listen", &port.to_string(), "--socket"]).arg(&path);
        Program::start(&mut command, folder, port)
    };
    let killed = start(tempfile::tempdir().unwrap());
    killed.signal(Signal::KILL);
    assert_eq!(killed.wait().code(), None);
    assert!(path.exists(), "kill -9 leaves the socket");
    let program = start(folder);
    converse(&mut program.session(), "show version\n", "mobgate 0.");
    program.signal(Signal::TERM);
    program.logs("ended by SIGTERM");
    wait_for("the socket's end", || (!path.exists()).then_some(()));
}

#[test]
fn by_default_the_socket_is_in_a_folder_of_its_own_and_is_found_there() {
    mobgate_simulator::own_network::require_user_namespaces();
    // In namespaces of their own: with a /run that can be written to, and with one that cannot.
    let script = r#"
        mount -t tmpfs -o "$3" run /run
        "$0" --listen "$1" </dev/null >/dev/null 2>"$2/log" &
        for _ in $(seq 200); do "$0" console show version && break; sleep 0.1; done
        timeout 3 "$0" --listen "$4" </dev/null 2>&1 >/dev/null | grep 'no console socket'
        find /run "$2" -type s
        kill "$!"; wait "$!"
    "#;
    for (options, place) in [("mode=755", "/run/mobgate/console"), ("ro", "/runtime/mobgate/console")] {
        let folder = tempfile::tempdir().unwrap();
        let runtime = folder.path().join("runtime");
        fs::create_dir(&runtime).unwrap();
        let (port, other) = (free_port().to_string(), free_port().to_string());
        let mut command = std::process::Command::new("unshare");
        command.args(["--user", "--map-root-user", "--mount", "--net", "sh", "-c", script]);
        command.args([env!("CARGO_BIN_EXE_mobgate"), &port]).arg(folder.path()).args([options, &other]);
        let output = command.env("XDG_RUNTIME_DIR", runtime).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(said.starts_with("mobgate 0."), "{said} {output:?}");
        assert!(said.contains(&format!("{place}\n")), "{said}");
        assert!(
            said.contains(&format!("{place} is in use by another gateway; --socket PATH names")),
            "{said}"
        );
    }
}

/// Runs `mobgate console` with `arguments`, and with `lines` on its standard input.
fn client(program: &Program, arguments: &[&str], lines: &str) -> (Option<i32>, String) {
    let input = program.config().with_file_name("lines");
    fs::write(&input, lines).unwrap();
    let mut command = mobgate();
    command.arg("console").arg("--socket").arg(program.socket()).args(arguments);
    let output = command.stdin(File::open(input).unwrap()).output().unwrap();
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

#[test]
fn user_add_makes_a_user_who_can_log_in_by_network_and_is_saved() {
    let at = format!("127.0.0.1:{}", free_port());
    let options = ["--config", "{folder}/mobgate.conf", "--socket", "{folder}/console", "--console", &at];
    let program = Program::with("port P502 tcp server {port}\n", &options);
    let add = |arguments: &[&str], typed: &str| {
        let input = program.config().with_file_name("typed");
        fs::write(&input, typed).unwrap();
        let mut command = mobgate();
        command.args(["user", "add"]).args(arguments).arg("--socket").arg(program.socket());
        let output = command.stdin(File::open(input).unwrap()).output().unwrap();
        let said = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(said).unwrap())
    };
    let config = || fs::read_to_string(program.config()).unwrap();
    for (arguments, typed, status, said) in [
        (&["4nna"][..], "battery staple\n", 1, "\"4nna\": expected a user's name"),
        (&["anna"], "short\n", 1, "a password has 8 to 64 characters"),
        (&["anna"], "", 1, "mobgate: no password was given"),
        (&["anna", "--role", "boss"], "battery staple\n", 2, "viewer, operator, engineer"),
    ] {
        let (code, told) = add(arguments, typed);
        assert_eq!(code, Some(status), "{told}");
        assert!(told.contains(said) && !told.contains("battery") && !told.contains("short"), "{told}");
    }
    assert!(!config().contains("user"), "nothing was saved");

    let (code, told) = add(&["anna"], "battery staple\n");
    assert_eq!((code, told.ends_with("anna may log in as engineer\n")), (Some(0), true), "{told}");
    assert!(config().contains("user anna role engineer password \"$argon2id$"), "{}", config());
    let port = at.rsplit_once(':').unwrap().1.parse().unwrap();
    converse(&mut tcp_session(port), "anna\nbattery staple\nshow version\n", "mobgate 0.");
    // Again: another role and password, as where one is forgotten.
    assert_eq!(add(&["anna", "--role", "viewer"], "correct horse\n").0, Some(0));
    converse(&mut tcp_session(port), "anna\nbattery staple\n", "no such user, or another password");
    converse(&mut tcp_session(port), "anna\ncorrect horse\nsave\n", "yours is viewer");
}

#[test]
fn a_line_of_the_command_line_is_carried_out_and_the_status_says_whether_it_was_refused() {
    let program = with_console("port P502 tcp server {port}\n");
    let (status, said) = client(&program, &["show", "version"], "");
    assert!(said.starts_with("mobgate 0.") && said.ends_with('\n'), "{said:?}");
    assert_eq!(status, Some(0));
    assert_eq!(client(&program, &["route", "P502", "2-9", "*", "-1", "local"], ""), (Some(0), String::new()));
    let (status, said) = client(&program, &["shwo version"], "");
    assert_eq!((status, said.starts_with("error: ")), (Some(1), true));
    let (status, said) = client(&program, &[], "show config\nshwo\nshow version");
    assert_eq!(status, Some(1));
    for part in ["route P502", "error: line 2", "mobgate 0."] {
        assert!(said.contains(part), "{part} is not in {said:?}");
    }
    // More than fits into the socket both ways.
    let (status, said) = client(&program, &[], &"show config\n".repeat(20_000));
    assert_eq!((status, said.lines().count()), (Some(0), 40_000));
}

#[test]
fn without_a_gateway_the_client_says_how_to_name_one() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("console");
    let asked = output(&["console", "--socket", socket.to_str().unwrap(), "show", "version"]);
    assert_eq!(asked.status.code(), Some(3));
    assert!(String::from_utf8(asked.stderr).unwrap().contains(socket.to_str().unwrap()));
}

#[test]
fn others_than_root_the_own_user_and_the_group_are_refused() {
    // Another user's process can only be had by root; else the decision alone is tested, beside its code.
    if !rustix::process::geteuid().is_root() {
        return;
    }
    // Where the other user gets at it.
    let folder = tempfile::tempdir_in("/tmp").unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let (port, socket) = (free_port(), folder.path().join("console"));
    let mut command = mobgate();
    command.args(["--listen", &port.to_string(), "--socket"]).arg(&socket);
    let program = Program::start(&mut command, tempfile::tempdir().unwrap(), port);
    let mut connect = std::process::Command::new("setpriv");
    connect.args(["--reuid", "65534", "--regid", "65534", "--clear-groups", "socat", "-"]);
    let asked =
        connect.arg(format!("UNIX-CONNECT:{}", socket.display())).stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&asked.stdout);
    assert!(said.starts_with("error: the console is for root"), "{said:?} {asked:?}");
    program.logs("console refused to user 65534");
}
