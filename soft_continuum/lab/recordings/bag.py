# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP files as ``ros2 bag`` writes them: serialized messages with their definitions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module
from math import prod
from pathlib import Path
import re
import struct
from typing import Any, BinaryIO, NamedTuple, Self

from soft_continuum.extras import needed
from soft_continuum.lab.analysis.delimited import MeasurementError
from soft_continuum.text import MAX_NAME, printable

ABOUT = 'soft_continuum'  # name of the metadata
MAX_RECORD = 256_000_000  # bytes of a chunk or an attachment: one picture is less than 100 MB
MAX_ATTACHMENT, MAX_ATTACHMENTS = 1_000_000, 20  # bytes of one that is read, and how many are
MAX_DECODED = 1_000_000  # bytes of a message that is decoded
MAX_DEFINITION = 100_000  # characters
BAG = 'recording.mcap'
"""The file that ``record`` writes into its directory."""
DESCRIPTION = 'description.yaml'
"""Attachment: the recorded arm as a parameter file."""
PARAMETERS = 'parameters.yaml'
"""Attachment: the parameters of all running nodes."""
PICTURES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')
MAX_ARRAY = 100_000  # elements of the arrays of fixed size in a definition, multiplied
FIXED_SIZE = re.compile(r'\[(\d+)\]')
MESSAGE_KIND = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Za-z][A-Za-z0-9]*)')
MESSAGE_FIELD = re.compile(r'^([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^]]*\])?\s+\w+')
PRIMITIVES = {'bool', 'byte', 'char', 'string', 'wstring', 'float32', 'float64', *(
    f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64))}
SEPARATOR = '=' * 80


class BagError(MeasurementError):
    """A file is not a recording; the message has the reason."""


class Topic(NamedTuple):
    """A topic: its absolute name, its type, as pkg/msg/Name, and the definition of that."""

    name: str
    kind: str
    definition: str
    qos: str = ''


class BagWriter:
    """
    A writer of an MCAP file.  Use it in one thread, and ``close`` it.

    Messages before the last ``flush`` are on the disk even if this process is killed.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        """Create a new file; raises OSError, and BagError without the packages."""
        with needed(BagError):
            from mcap.writer import Writer
        self._file: BinaryIO = path.open('xb')
        # Chunks end when they are flushed: some are more than a tool likes to have in one.
        self._writer: Any = Writer(self._file, chunk_size=4_000_000)
        self._writer.start(profile='ros2', library=f'soft_continuum {about.get("version", "")}')
        self._writer.add_metadata(ABOUT, dict(about))
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self.flush()

    def write(self, topic: Topic, time: int, data: bytes) -> None:
        """Add a message received at ``time``, ns since 1970; raises OSError."""
        if topic.kind not in self._schemas:
            self._schemas[topic.kind] = self._writer.register_schema(
                topic.kind, 'ros2msg', topic.definition.encode())
        if topic.name not in self._channels:
            self._channels[topic.name] = self._writer.register_channel(
                topic.name, 'cdr', self._schemas[topic.kind], {'offered_qos_profiles': topic.qos})
        self._writer.add_message(self._channels[topic.name], time, data, time)

    def attach(self, name: str, text: str, time: int) -> None:
        """Add a text file; raises OSError."""
        self._writer.add_attachment(time, time, name, 'text/plain', text.encode())

    def flush(self) -> None:
        """Write everything to the disk; raises OSError."""
        self._writer.flush()
        self._file.flush()

    def close(self) -> None:
        """End the file with its index; raises OSError."""
        try:
            self._writer.finish()
        finally:
            self._file.close()


class Message(NamedTuple):
    """
    One message: its topic, the time of reception, ns since 1970, and its serialized data.

    channel: number of its channel in the file.
    """

    topic: Topic
    time: int
    data: bytes
    channel: int


class BagReader:
    """
    Reads an MCAP file of ROS 2 sequentially, also one without its end.

    about: the metadata that BagWriter began it with.  attachments: text by name; only those before
    the present position.  damage: why it could not be read to its end; empty if it could.
    """

    def __init__(self, path: Path) -> None:
        """Open the file; raises BagError."""
        with needed(BagError):
            from mcap.stream_reader import StreamReader
            from mcap_ros2.decoder import DecoderFactory
        self._path = path
        self.about: dict[str, str] = {}
        self.attachments: dict[str, str] = {}
        self.damage = ''
        try:
            self._file: BinaryIO = path.open('rb')
        except OSError as error:
            raise BagError(f'{path}: {error.strerror}') from None
        self._records = StreamReader(self._file, emit_chunks=True, record_size_limit=MAX_RECORD)
        self._new_factory = DecoderFactory
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, tuple[Topic, Any]] = {}  # and its schema
        self._decoders: dict[int, Any] = {}  # by channel

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()

    def messages(self) -> Iterator[Message]:
        """Yield every message of ROS 2 in the order of the file; raises BagError."""
        from mcap.exceptions import EndOfFile, InvalidMagic, McapError
        from mcap.records import Attachment, Chunk, Header, Metadata
        from mcap.stream_reader import breakup_chunk
        from zstandard import ZstdError
        known = False
        try:
            for record in self._records.records:
                if isinstance(record, Header):
                    known = True
                elif isinstance(record, Metadata) and record.name == ABOUT:
                    self.about = {k: printable(v) for k, v in record.metadata.items()}
                elif (isinstance(record, Attachment) and len(record.data) <= MAX_ATTACHMENT
                        and len(self.attachments) < MAX_ATTACHMENTS):
                    self.attachments[record.name] = record.data.decode('utf-8', 'replace')
                elif isinstance(record, Chunk):
                    for inner in breakup_chunk(_unpacked(record), validate_crc=True):
                        yield from self._messages(inner)
                else:
                    yield from self._messages(record)
        except (EndOfFile, InvalidMagic, struct.error):
            self.damage = 'its end is missing: the recorder was killed before it finished'
        except (McapError, ZstdError, RuntimeError, ValueError, KeyError, IndexError,
                MemoryError, OverflowError) as error:
            self.damage = f'damaged: {printable(str(error), MAX_NAME)}'
        if not known:
            raise BagError(f'{self._path}: not an MCAP file; give one that record or ros2 bag has '
                           'written')

    def arm_in(self, spaces: Sequence[str], namespace: str) -> str:
        """
        Return the namespace of the requested arm, after all messages were read.

        spaces: of the arms in the file.  namespace: as given by the user; empty: the only arm, or
        that of the recorder.  Raises BagError.
        """
        if not namespace and len(spaces) > 1:
            namespace = self.about.get('namespace', '')
        wanted = '/' + namespace.strip('/')
        chosen = [space for space in spaces if space == wanted] if namespace else spaces
        if not spaces:
            raise BagError(f'{self._path}: no arm is recorded in '
                           f'it{"; " + self.damage if self.damage else ""}')
        if len(chosen) != 1:
            raise BagError(f'{self._path}: it has arms in the namespaces {", ".join(spaces)}; '
                           'choose one with --namespace')
        return chosen[0]

    def said_of(self, space: str, name: str) -> str:
        """Return an attachment if it belongs to the arm in ``space``."""
        return self.attachments.get(name, '') if space == self.about.get('namespace') else ''

    def _messages(self, record: Any) -> Iterator[Message]:
        """Yield what a record is if it is a message; keep what it says of those that follow."""
        from mcap.records import Channel, Schema
        from mcap.records import Message as McapMessage
        if isinstance(record, Schema) and record.encoding == 'ros2msg':
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            schema = self._schemas.get(record.schema_id)
            if schema is not None and record.message_encoding == 'cdr':
                self._channels[record.id] = Topic(
                    record.topic, schema.name, schema.data.decode('utf-8', 'replace'),
                    record.metadata.get('offered_qos_profiles', '')), schema
                self._decoders.pop(record.id, None)
        elif isinstance(record, McapMessage) and record.channel_id in self._channels:
            yield Message(self._channels[record.channel_id][0], record.log_time, record.data,
                          record.channel_id)

    def decoded(self, message: Message) -> Any:
        """Return the deserialized message; raises BagError."""
        topic, schema = self._channels[message.channel]
        try:
            if message.channel not in self._decoders:
                sizes = map(int, FIXED_SIZE.findall(topic.definition))
                if len(topic.definition) > MAX_DEFINITION or prod(sizes) > MAX_ARRAY:
                    raise ValueError('its definition is too large')
                # One for each: they keep decoders by the numbers of schemas, which may be reused.
                self._decoders[message.channel] = self._new_factory().decoder_for('cdr', schema)
            if len(message.data) > MAX_DECODED:
                raise ValueError(f'{len(message.data)} bytes; at most {MAX_DECODED} are read')
            return self._decoders[message.channel](message.data)
        except Exception as error:  # of an invalid definition or invalid data
            raise BagError(f'{self._path}: a message of {printable(topic.name, MAX_NAME)} cannot '
                           f'be read as {printable(topic.kind, MAX_NAME)}: '
                           f'{printable(str(error), MAX_NAME)}') from None


def _unpacked(chunk: Any) -> Any:
    """Return a chunk without compression; raises ValueError for one that is too large."""
    if chunk.compression == 'zstd':
        from zstandard import ZstdDecompressor
        # The size in a frame header is not trustworthy.
        data = ZstdDecompressor().stream_reader(chunk.data).read(MAX_RECORD + 1)
    elif chunk.compression == 'lz4':
        from lz4.frame import LZ4FrameDecompressor
        data = LZ4FrameDecompressor().decompress(chunk.data, MAX_RECORD + 1)
    else:
        return chunk
    if len(data) > MAX_RECORD:
        raise ValueError(f'a chunk of more than {MAX_RECORD / 1e6:g} MB')
    return replace(chunk, compression='', data=data)


class DefinitionError(LookupError):
    """The definition of a type is not installed."""


def message_class(kind: str) -> Any:
    """
    Return the class of a type, pkg/msg/Name; raises DefinitionError.

    The name comes from the network or a file: only installed ROS packages that define this type
    are imported.
    """
    definition(kind)
    package, _, name = kind.split('/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        raise DefinitionError(f'{kind} is not installed for Python') from None


@cache
def definition(kind: str) -> str:
    """
    Return the definition of a type, pkg/msg/Name, followed by those of all types in it.

    As rosbag2 stores it: each of the others after a line of equals signs and ``MSG: pkg/Name``.
    Raises DefinitionError.
    """
    text = _text(kind)
    parts, found, waiting = [text], {kind}, _used(kind, text)
    while waiting:
        inner = waiting.pop(0)
        if inner not in found:
            found.add(inner)
            text = _text(inner)
            package, _, name = inner.split('/')
            parts.append(f'{SEPARATOR}\nMSG: {package}/{name}\n{text}')
            waiting += _used(inner, text)
    return '\n'.join(parts)


def _text(kind: str) -> str:
    from ament_index_python.packages import get_package_share_directory, PackageNotFoundError
    named = MESSAGE_KIND.fullmatch(kind)
    if named is None:
        raise DefinitionError(f'{kind!r} is not a message type')
    try:
        path = Path(get_package_share_directory(named[1]), 'msg', f'{named[2]}.msg')
        return path.read_text(encoding='utf-8')
    except (PackageNotFoundError, OSError, ValueError):
        raise DefinitionError(f'the definition of {kind} is not installed') from None


def _used(kind: str, text: str) -> list[str]:
    """Return the types of the fields, but primitive ones, as pkg/msg/Name."""
    found = []
    for line in text.splitlines():
        field = MESSAGE_FIELD.match(line.split('#')[0].strip())
        if field and field[1] not in PRIMITIVES:
            names = field[1].split('/')
            found.append(f'{names[0] if len(names) > 1 else kind.split("/")[0]}/msg/{names[-1]}')
    return found
