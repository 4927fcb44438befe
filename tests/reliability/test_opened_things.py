"""Every listener, thread, child process, link and written file: its bound, its time limit, and what it says in trouble.

A place of the code that opens one and stands in no row fails, so does a row whose place or test is gone.
"""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
# Names of what opens a thing, whatever stands before the name.
OPENERS = frozenset({
    "Thread", "Timer", "ThreadPoolExecutor", "ProcessPoolExecutor", "ThreadingMixIn", "Popen", "Process", "fork",
    "create_server", "start_server", "start_unix_server", "make_server", "serve", "bind", "listen",
    "create_connection", "Serial", "Bus", "Client", "BleakClient", "InfluxDBClient", "urlopen", "build_opener",
    "openpty", "mkfifo", "FileHandler", "FileIO", "ZipFile", "NamedTemporaryFile", "TemporaryFile", "mkstemp",
    "TemporaryDirectory", "mkdtemp", "write_text", "write_bytes",
})  # fmt: skip
# They have such a name and open nothing.
OTHERS = {
    "core/links/ble_link.py:find", "core/links/ble_source.py:_listen",  # listeners of advertisements
    "core/session/session_opening.py:open_session",  # hands over to the row of commands
    "fleet/local_tasks.py:LocalTasks._end_above_limit",  # looks at a process
}  # fmt: skip


class Row(NamedTuple):
    """A thing.

    Attributes:
        places: module below gateway, and the function or class that opens it.
        bound: of what it can take.
        limit: of the time that it can take.
        stops: what is said when it ends by an error, or hangs.
        floods: when more comes than it can take.
        lies: when what comes cannot be true.
        gone: when its other side leaves.
        tests: that hold these statements.
    """

    places: str
    bound: str
    limit: str
    stops: str
    floods: str
    lies: str
    gone: str
    tests: str


NOTHING = "nothing from outside"
ROWS = {
    # Listeners
    "page": Row(
        "publishing/page_server.py:PageSink.open publishing/page_server.py:PageSink._serve "
        "publishing/page_server.py:_listener",
        "64 connections, 32 of a peer; 20 pages; 4 kB a message; 5 marks a second", "5 s for a request; pings",
        "thread named, session fails", "one too many is closed or answered 503; a slow page gets the latest state",
        "400, 403, 405", "closed without a word: browsers come and go",
        "publishing/test_listeners.py::test_idle_connections_of_one_peer_are_bounded "
        "publishing/test_listeners.py::test_a_request_that_does_not_come_ends_its_connection "
        "publishing/test_listeners.py::test_requests_are_answered_without_a_traceback "
        "publishing/test_listeners.py::test_one_client_cannot_flood_marks_and_recordings "
        "publishing/test_listeners.py::test_the_page_is_there_again_when_strangers_are_gone "
        "publishing/test_page.py::test_twenty_pages_and_one_too_many "
        "publishing/test_page.py::test_slow_page_holds_nobody_and_gets_the_latest "
        "reliability/test_stopped_parts.py::test_thread_that_raises_fails_the_session_and_keeps_its_recording",
    ),
    "foxglove": Row(
        "publishing/foxglove_server.py:FoxgloveSink.open publishing/origin_gate.py:hidden_loopback "
        "publishing/origin_gate.py:OriginGate.__init__ publishing/origin_gate.py:OriginGate._accept "
        "publishing/origin_gate.py:OriginGate._serve",
        "64 connections, 32 of a peer; 16 kB of a head", "5 s for the head, 10 s for a viewer that takes nothing",
        "accepts again after an error", "one too many is closed; the oldest messages of a slow viewer are dropped",
        "403", "closed",
        "publishing/test_listeners.py::test_idle_connections_of_one_peer_are_bounded "
        "publishing/test_listeners.py::test_a_request_that_does_not_come_ends_its_connection "
        "publishing/test_listeners.py::test_the_gate_accepts_again_after_an_error "
        "publishing/test_listeners.py::test_a_viewer_that_takes_nothing_is_left "
        "publishing/test_listeners.py::test_a_client_that_reads_nothing_holds_nobody "
        "publishing/test_foxglove.py::test_only_the_allowed_origin_alone_is_admitted "
        "publishing/test_foxglove.py::test_what_is_no_websocket_is_refused "
        "publishing/test_foxglove.py::test_port_in_use_is_named_and_waited_for",
    ),
    "prometheus": Row(
        "publishing/prometheus.py:_Server publishing/prometheus.py:PrometheusEndpoint.open",
        "64 connections, 32 of a peer", "5 s for a request, and for each part of an answer",
        "thread named, session fails", "one too many is closed", "400", "closed",
        "publishing/test_listeners.py::test_idle_connections_of_one_peer_are_bounded "
        "publishing/test_listeners.py::test_a_request_that_does_not_come_ends_its_connection "
        "publishing/test_listeners.py::test_all_peers_together_are_bounded "
        "publishing/test_listeners.py::test_a_client_that_reads_nothing_holds_nobody "
        "publishing/test_prometheus.py::test_port_in_use_is_named",
    ),
    "commands": Row(
        "security/control_socket.py:ControlSocket._listen security/control_socket.py:ControlSocket._accept",
        "8 clients of this user; 4 kB of a request", "2 s for a request",
        "thread named, session fails; a failure that stays is told once", "one too many is closed; a slow one is left",
        "no", "closed",
        "core/session/test_control_socket.py::test_socket_is_of_this_user_alone "
        "core/session/test_control_socket.py::test_other_links_and_strange_requests_are_refused "
        "core/session/test_control_socket.py::test_failure_that_stays_is_told_once "
        "core/session/test_control_socket.py::test_reader_that_is_too_slow_does_not_hold_the_session_up "
        "core/session/test_control_socket.py::test_command_ends_when_the_session_does "
        "reliability/test_stopped_parts.py::test_thread_that_raises_fails_the_session_and_keeps_its_recording",
    ),
    # Threads
    "session": Row(
        "core/session/live.py:LiveSession.__init__",
        "8192 items of each queue", "4 s of an estimator, 20 s of other work",
        "alarm with its name; the recording is finished; the session fails", "counted by stage",
        "the item is refused with its time", "link lost",
        "reliability/test_stopped_parts.py::test_thread_that_raises_fails_the_session_and_keeps_its_recording "
        "reliability/test_stopped_parts.py::test_estimator_that_never_returns_is_named_and_the_recording_finished "
        "reliability/test_stopped_parts.py::test_item_without_a_possible_time_is_refused_alone "
        "reliability/test_stopped_parts.py::test_source_that_raises_ends_alone "
        "reliability/test_slow_consumers.py::test_slow_estimates_do_not_affect_the_recording",
    ),
    "recording": Row(
        "core/session/recording_stage.py:RecordingStage.__init__",
        "items and bytes of its queue", "a disk that takes nothing at the end is named",
        "RECORDING STOPPED: alarm, exit status", "topics go first, then counted chunks",
        "a time without a place is refused", "deleted file named",
        "reliability/test_slow_consumers.py::test_stuck_disk_does_not_delay_estimates "
        "reliability/test_slow_consumers.py::test_disk_stuck_too_long_loses_topics_first "
        "reliability/test_slow_consumers.py::test_hanging_disk_is_reported_without_waiting "
        "reliability/test_stopped_parts.py::test_recording_that_fails_by_our_own_fault_is_an_alarm_and_a_failure "
        "reliability/test_stopped_parts.py::test_recording_refuses_a_time_without_a_place_and_can_be_finished "
        "reliability/test_recording_survives.py::test_removed_folder_stops_the_recording_only",
    ),
    "output": Row(
        "publishing/sink_worker.py:SinkWorker.__init__",
        "8192 items, 5 % of them for alarms only", "an end waits for a receiver that takes items",
        "a fault costs one item; thread named, session fails", "dropped and counted", "refused and counted",
        "named with its age; reached again",
        "publishing/test_sink_worker.py::test_stalled_receiver_is_bounded_and_counted "
        "publishing/test_sink_worker.py::test_lost_receiver_is_reached_again_with_the_same_item "
        "publishing/test_sink_worker.py::test_fault_of_an_output_costs_one_item_only "
        "publishing/test_sink_worker.py::test_drops_are_told_by_what_causes_them "
        "publishing/test_sink_worker.py::test_end_leaves_a_dead_receiver_and_waits_for_a_slow_one "
        "reliability/test_stopped_parts.py::test_thread_that_raises_fails_the_session_and_keeps_its_recording",
    ),
    "counters of keys": Row(
        "core/session/frame_guard.py:GuardWatch.tick",
        "one at a time", "joined for a time at the end, else named",
        "not saved, with error and remedy", NOTHING, NOTHING, "not saved",
        "security/test_guard.py::test_counters_persist_after_session "
        "security/test_guard.py::test_identity_flood_keeps_state_bounded "
        "security/test_sessions.py::test_unsaved_counters_are_reported_once "
        "security/test_sessions.py::test_counters_that_a_slow_disk_saves_late_are_named",
    ),
    "opening of a link": Row(
        "core/links/reconnect.py:_Attempt.__init__",
        "one for each link", "its link's", "raised by the thread that waits", NOTHING, NOTHING, "closed once it opens",
        "core/links/test_reconnect.py::test_first_opening_raises "
        "core/links/test_reconnect.py::test_stop_does_not_wait_for_a_hanging_opening",
    ),
    "dialogue of setup": Row(
        "bench/commands/setup_dialogue.py:Dialogue.__enter__",
        "4096 items and lines", "15 s without samples", "raised by the dialogue", "the link waits",
        "asked again", "an answer is missing",
        "bench/test_setup.py::test_what_ends_a_thread_of_the_dialogue_ends_the_dialogue "
        "bench/test_setup.py::test_a_link_that_floods_waits_for_the_dialogue "
        "bench/test_setup.py::test_bytes_without_samples_are_no_sensor "
        "bench/test_setup.py::test_wrong_and_missing_answers_write_nothing",
    ),
    "reading ahead of a check": Row(
        "core/links/read_ahead.py:ReadAheadSource.items makers/commands/protocol_check.py:_items",
        "what comes in the stated time", "the stated time, and a little", "raised by the items",
        "a dump does not read ahead", "named by its clause", "its report so far",
        "core/links/test_time_limit.py::test_a_source_read_ahead_does_not_wait_for_its_reader "
        "core/links/test_time_limit.py::test_what_the_reading_thread_raises_is_raised_by_the_items "
        "makers/test_protocol_check.py::test_a_silent_hub_does_not_keep_the_check "
        "makers/test_protocol_check.py::test_a_link_that_breaks_ends_the_check_with_its_report "
        "makers/test_protocol_check.py::test_a_dump_whose_reader_stops_does_not_fill_the_memory",
    ),
    "command to a hub": Row(
        "security/hub_commands.py:execute",
        "one command", "the time limit of the command", "no reply", "other frames are passed over",
        "a reply without the counter or a signature is none", "hub lost",
        "core/ble/test_ble_session.py::test_missing_reply_is_an_error "
        "core/ble/test_ble_session.py::test_hub_lost_before_its_reply "
        "security/test_signed_commands.py::test_reply_that_is_not_genuine_does_not_count",
    ),
    "files of a campaign": Row(
        "fleet/campaign_run.py:CampaignRun.run",
        "64 files ahead", "ends with the run", "raised by the run", "waits", "a failure row", "a failure row",
        "fleet/test_campaign_run.py::test_error_of_the_thread_that_identifies_files_ends_the_campaign "
        "fleet/test_campaign_run.py::test_bad_file_is_a_failure_row "
        "fleet/test_campaign_run.py::test_a_link_to_nothing_is_a_failure "
        "fleet/test_campaign_run.py::test_stop_leaves_a_whole_dataset",
    ),
    # Child processes
    "workers": Row(
        "core/worker_pool.py:Worker core/worker_pool.py:_begin",
        "the stated number; memory of a campaign", "ends with the command, also a killed one",
        "terminated from outside, with a remedy; a campaign tries once more", "named with the limit of memory",
        NOTHING, "named",
        "core/session/test_shared_work.py::test_terminated_process_is_reported "
        "core/session/test_shared_work.py::test_closed_work_and_workers_leave_no_process "
        "fleet/test_campaign_run.py::test_killed_worker_is_tried_once_more "
        "fleet/test_campaign_run.py::test_worker_out_of_memory_is_a_failure "
        "reliability/test_orphaned_workers.py::test_idle_and_busy_workers_end_with_a_killed_command",
    ),
    "foreign parsers": Row(
        "importing/reader_process.py:ReaderProcess.__init__ importing/reader_process.py:_serve",
        "memory by the size of the file", "60 s and by the size of the file", "crashed, with its signal",
        "an error about memory", "an error of the file", "crashed",
        "importing/test_reader_process.py::test_file_that_crashes_its_parser_is_an_error "
        "importing/test_reader_process.py::test_parser_killed_while_reading_is_an_error "
        "importing/test_reader_process.py::test_parser_that_hangs_is_ended "
        "importing/test_reader_process.py::test_absurd_size_is_an_error_about_memory "
        "importing/test_reader_process.py::test_failing_file_leaves_no_process",
    ),
    "dask": Row(
        "fleet/scheduler_tasks.py:_in_time fleet/scheduler_tasks.py:scheduler_tasks.AbandonedClient",
        "as many tasks as threads of workers", "20 s to connect, 60 s for an answer or a sign of life of a worker",
        "tried once more, then a failure row; a silent worker is named", NOTHING, "named as not treadlink's",
        "the connection was lost; the same command goes on",
        "fleet/test_scheduler_tasks.py::test_a_silent_worker_is_named_and_its_task_given_to_another "
        "fleet/test_scheduler_tasks.py::test_a_worker_that_ends_is_a_reason "
        "fleet/test_scheduler_tasks.py::test_what_is_no_scheduler_is_an_error_in_time "
        "fleet/test_scheduler_tasks.py::test_results_of_a_strange_worker_end_the_campaign "
        "fleet/test_scheduler_tasks.py::test_strange_events_of_a_scheduler_are_left_out "
        "fleet/test_scheduler_tasks.py::test_scheduler_that_ends_is_named_and_what_is_done_is_kept",
    ),
    # Links
    "TCP hub": Row(
        "core/links/tcp_link.py:connect",
        "one connection", "to connect, of silence, of keepalive", "lost, tried again", "counted by stage",
        "rejected frames counted", "lost, tried again",
        "core/links/test_tcp_link.py::test_silent_host_is_given_up "
        "core/links/test_tcp_link.py::test_vanished_peer_is_found_by_keepalive "
        "core/links/test_tcp_link.py::test_closing_peer_is_a_lost_link "
        "core/links/test_tcp_link.py::test_peer_that_keeps_the_connection_and_sends_nothing_is_connected_again "
        "core/session/test_live_session.py::test_device_faster_than_the_core_loses_counted_items",
    ),
    "serial port": Row(
        "core/links/serial_link.py:serial_port",
        "one port, not shared", "of silence, of a write", "lost, tried again", "counted by stage",
        "rejected frames counted", "lost, tried again",
        "core/links/test_serial_link.py::test_unplugged_port_is_reported_and_reopened "
        "core/links/test_serial_link.py::test_port_ready_without_data_is_lost "
        "core/links/test_serial_link.py::test_busy_port_is_not_to_be_shared "
        "core/links/test_serial_link.py::test_who_reads_the_port_too_is_named",
    ),
    "Bluetooth": Row(
        "core/links/ble_radio.py:Radio.__init__ core/links/ble_link.py:BleLink._connect",
        "bytes that wait for the reader", "of a scan, to connect, of silence, to leave", "lost, tried again",
        "drops reported", "rejected frames counted", "lost, tried again",
        "core/ble/test_ble_source.py::test_slow_reader_reports_drops "
        "core/ble/test_ble_source.py::test_silence_counts_as_a_lost_link "
        "core/ble/test_ble_source.py::test_lost_hub_is_reconnected "
        "core/ble/test_ble_failures.py::test_d_bus_ends_and_returns "
        "core/ble/test_ble_failures.py::test_bluetooth_crashes_and_returns",
    ),
    "CAN bus": Row(
        "vehicle/can_source.py:open_can_source publishing/can_bus.py:CanSink.open",
        "one bus", "1 s for a frame", "opened again", "counted by stage", "signals out of range are not available",
        "opened again; what waits is sent",
        "publishing/test_can.py::test_bus_that_fails_is_opened_again_and_gets_what_waits "
        "publishing/test_can.py::test_bus_that_cannot_be_opened_is_named "
        "publishing/test_can.py::test_no_item_is_lost_by_an_error_of_the_adapter "
        "publishing/test_can.py::test_unknown_and_impossible_values_are_not_available "
        "core/links/test_reconnect.py::test_a_bus_that_goes_off_and_returns_keeps_its_frames_and_its_errors",
    ),
    "MQTT": Row(
        "publishing/mqtt.py:_Client",
        "20 messages without a confirmation", "of a confirmation, of pings", "connected again", "dropped and counted",
        "a packet that is too large ends the connection", "connected again; what waits is sent",
        "publishing/test_broken_links.py::test_a_broker_that_swallows_confirmations_is_left_and_gets_the_items_again "
        "publishing/test_broken_links.py::test_every_item_arrives_over_a_link_that_breaks_in_every_way "
        "publishing/test_broken_links.py::test_items_that_the_broker_refuses_count_as_dropped "
        "publishing/test_hostile_broker.py::test_packet_above_the_maximum_ends_the_connection",
    ),
    "HTTP servers": Row(
        "publishing/influx.py:InfluxServer.open publishing/webhook.py:Webhook.__init__",
        "one request", "of an answer", "sent again", "dropped and counted", "refused, with a remedy",
        "named; sent again",
        "publishing/test_stalled_receivers.py::test_server_that_never_answers_is_left_in_time_and_gets_everything "
        "publishing/test_influx.py::test_what_the_server_refuses_is_sent_again "
        "publishing/test_influx.py::test_server_that_is_away_is_named "
        "publishing/test_webhook.py::test_a_refused_alarm_is_sent_again",
    ),
    # Files
    "output files": Row(
        "core/text/output_file.py:OutputFile.__init__ core/text/output_file.py:scratch_folder "
        "exporting/column_file.py:ColumnFile.__init__ exporting/formats/npz_file.py:NpzExport.end "
        "exporting/formats/npz_file.py:_put",
        "the disk", "none: the user waits", "no half file", "disk full, with a remedy", NOTHING, "its folder named",
        "core/text/test_output_file.py::test_error_leaves_the_old_file "
        "core/text/test_output_file.py::test_killed_process_leaves_no_half_file "
        "core/text/test_output_file.py::test_next_run_removes_what_a_killed_process_left "
        "exporting/test_export_command.py::test_full_disk_is_an_error_with_a_remedy "
        "exporting/test_export_command.py::test_full_disk_of_the_temporary_file_is_an_error_of_the_output",
    ),
    "recordings": Row(
        "core/recording/container.py:_open_new core/recording/container.py:_opened_part",
        "size or time of a part; two descriptors in reserve", "flushed twice a second",
        "goes on in the old part, tries again", "disk full: stopped, an alarm", NOTHING, "named; readable so far",
        "core/recording/test_split_writer.py::test_descriptors_of_the_next_file_are_reserved "
        "core/recording/test_split_writer.py::"
        "test_a_next_file_that_cannot_be_opened_is_tried_again_and_nothing_is_lost "
        "reliability/test_recording_survives.py::test_full_disk_stops_the_recording_only "
        "reliability/test_recording_survives.py::test_killed_command_keeps_its_recording",
    ),
    "notes of a recording": Row(
        "core/recording/run_description.py:add_note core/recording/run_description.py:copy_notes",
        "one line", "none: the user waits", "a note after half a note is read", NOTHING, "a damaged note is named",
        "an error",
        "core/recording/test_run_description.py::test_a_note_after_half_a_note_is_read "
        "core/recording/test_run_description.py::test_a_damaged_note_is_named "
        "core/recording/test_run_description.py::test_a_note_leaves_the_recording_as_it_was",
    ),
    "lines of live outputs": Row(
        "publishing/influx.py:InfluxFile._append publishing/json_lines.py:JsonLines.open",
        "those of the output", "0.1 s for a reader", "waited for", "disk full: waited for; dropped and counted",
        NOTHING, "a pipe waits for another reader",
        "publishing/test_json_lines.py::test_reader_of_a_pipe_may_stall_leave_and_return "
        "publishing/test_json_lines.py::test_full_disk_is_waited_for "
        "publishing/test_json_lines.py::test_half_a_line_of_a_killed_session_stands_alone "
        "publishing/test_influx.py::test_half_a_line_of_a_killed_session_stands_alone",
    ),
    "private files": Row(
        "security/private_file.py:write_private security/private_file.py:_acquired",
        "of this user alone", "of a lock", "the old file stays", NOTHING, "other files are refused", "an error",
        "security/test_keys.py::test_failed_write_keeps_the_old_file "
        "security/test_keys.py::test_lock_held_for_long_is_an_error "
        "security/test_keys.py::test_other_files_are_refused "
        "security/test_keys.py::test_readable_key_file_is_refused",
    ),
    "log": Row(
        "core/cli/logs.py:_file_handler",
        "repetitions are counted; 1000 lines behind a screen", "none: a disk", "an error at the start",
        "counted", "escaped", "an error at the start",
        "core/cli/test_logging.py::test_a_record_that_repeats_is_counted_and_its_traceback_printed_once "
        "core/cli/test_logging.py::test_records_are_held_back_behind_a_screen "
        "core/cli/test_logging.py::test_unwritable_log_file_is_an_error",
    ),
    "lock of a dataset": Row(
        "fleet/dataset.py:_locked",
        "one campaign", "until Ctrl-C, said once", "taken up again", "the second waits", NOTHING, "taken up again",
        "fleet/test_dataset.py::test_second_campaign_waits_for_the_first "
        "fleet/test_dataset.py::test_waiting_can_be_given_up "
        "fleet/test_dataset.py::test_a_dataset_whose_making_was_killed_is_taken_up",
    ),
    "copy of a UFF file": Row(
        "importing/uff_columns.py:_well_formed",
        "the file's size", "of foreign parsers", "crashed, with its signal", NOTHING, "an error of the file",
        "removed with its folder",
        "importing/test_reader_process.py::test_failing_file_leaves_no_process",
    ),
    "simulated port": Row(
        "simulator/pty_link.py:PtyPort.__init__",
        "the terminal's buffer", "none: it never waits", NOTHING, "whole chunks dropped for a slow reader", NOTHING,
        "bytes without a reader are discarded",
        "simulator/test_simulate_command.py::test_pty_drops_whole_chunks_for_a_slow_reader "
        "simulator/test_simulate_command.py::test_pty_without_a_reader_discards_bytes",
    ),
    "nothing": Row(
        "core/cli/__init__.py:_flush_output",
        "one descriptor", "none", NOTHING, NOTHING, NOTHING, "a reader that left is quiet",
        "exporting/test_export_command.py::test_closed_pipe_ends_quietly",
    ),
}  # fmt: skip


def writes(call: ast.Call) -> bool:
    """Return whether a call has a mode or flags that write."""
    values = [argument.value for argument in call.args[:2] if isinstance(argument, ast.Constant)]
    values += [
        word.value.value for word in call.keywords if isinstance(word.value, ast.Constant) and word.arg == "mode"
    ]
    modes = [value for value in values if isinstance(value, str) and 0 < len(value) <= 4]
    return any(set(mode) <= set("rwaxbt+") and set(mode) & set("wax+") for mode in modes)


def last_name(node: ast.AST) -> str:
    return ast.unparse(node).rpartition(".")[2]


def opens(call: ast.Call) -> bool:
    whole = ast.unparse(call.func)
    name = last_name(call.func)
    if whole == "os.open":  # read-only where it is not said that it writes
        return not ast.unparse(call.args[1]).startswith("os.O_RDONLY")
    return name in OPENERS or whole.startswith("subprocess.") or (name == "open" and writes(call))


def openings(node: ast.AST, names: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the qualified names of functions and classes that open something."""
    for child in ast.iter_child_nodes(node):
        inner = names
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inner = (*names, child.name)
            if isinstance(child, ast.ClassDef) and OPENERS.intersection(map(last_name, child.bases)):
                yield ".".join(inner)
        elif isinstance(child, ast.Call) and opens(child):
            yield ".".join(names)
        yield from openings(child, inner)


def places_in(code: str, module: str) -> set[str]:
    return {f"{module}:{name}" for name in openings(ast.parse(code))}


def test_everything_that_is_opened_has_a_row() -> None:
    opened = set()
    for path in (ROOT / "gateway").rglob("*.py"):
        opened |= places_in(path.read_text(), path.relative_to(ROOT / "gateway").as_posix())
    listed = [place for row in ROWS.values() for place in row.places.split()]
    assert len(listed) == len(set(listed)), "a place has one row"
    assert sorted(opened - OTHERS - set(listed)) == [], "give each a row: its bound, its time limit, its words"
    assert sorted({*listed, *OTHERS} - opened) == [], "these are gone"


@pytest.mark.parametrize("name", ROWS)
def test_each_row_is_complete_and_its_tests_exist(name: str) -> None:
    row = ROWS[name]
    assert all(row)
    for test in row.tests.split():
        path, _, function = test.partition("::")
        functions = [node.name for node in ast.parse((TESTS / path).read_text()).body if hasattr(node, "name")]
        assert function in functions, test


@pytest.mark.parametrize(
    "code",
    [
        "threading.Thread(target=f)", "socket.create_server(a)", "path.open('ab')", "open(path, mode='x')",
        "os.open(path, os.O_WRONLY)", "subprocess.run([])", "class _A(ProcessPoolExecutor): pass", "a.write_text('')",
    ],
)  # fmt: skip
def test_a_new_one_is_seen(code: str) -> None:
    assert places_in(code, "m")


@pytest.mark.parametrize(
    "code", ["path.open('rb')", "os.open(path, os.O_RDONLY)", "a.write(b)", "text.replace('+', '')"]
)
def test_what_only_reads_is_none(code: str) -> None:
    assert not places_in(code, "m")
