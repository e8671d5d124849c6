"""What a log holds, found before anything is estimated: topics, counts, duration, first calibrations."""

from dataclasses import dataclass, field

from ..mcap_file.damage import Damage
from ..sources.source import Channel, Contents, Message, Source
from .messages import CalibrationMessage, MessageDecoder, UndecodableMessage, kind_of
from .rig import calibration_error

# A log without an index is scanned this far at most, once cameras and calibrations have been met: some seconds of
# reading, and enough for calibrations that are sent every few seconds.
_SCAN_BYTES = 256 * 2**20
# Of calibration topics the first message is kept while scanning, within these bounds; others are read when needed.
_KEPT_CALIBRATIONS, _KEPT_BYTES = 64, 2**16


@dataclass(slots=True)
class Topic:
    """One topic. `kind` as in `messages.kind_of`; `count` of messages, None where it is not known."""

    name: str
    kind: str
    schema: str
    encoding: str
    count: int | None


@dataclass(slots=True)
class Survey:
    """The topics by name, the span of log times, and the first messages of some calibration topics."""

    topics: dict[str, Topic]
    start_ns: int = 0
    end_ns: int = 0
    whole: bool = True  # false: the scan ended early, counts and span are lower bounds
    first_calibrations: dict[str, Message] = field(default_factory=dict)

    def of_kind(self, *kinds: str) -> dict[str, int | None]:
        """Topic -> count for the topics of these kinds."""
        return {t.name: t.count for t in self.topics.values() if t.kind in kinds}


def survey_log(source: Source, damage: Damage) -> Survey:
    """Survey a log by its index where it has one that can be trusted, else by reading it in order."""
    contents = source.contents()
    return _scan(source, damage) if contents is None else _from_contents(contents)


def _from_contents(contents: Contents) -> Survey:
    survey = Survey({}, contents.start_ns, contents.end_ns)
    for channel, count in contents.channels:
        known = survey.topics.get(channel.topic)
        if known is None:
            survey.topics[channel.topic] = _topic(channel, count)
        elif count is not None:
            known.count = (known.count or 0) + count
    return survey


def _scan(source: Source, damage: Damage) -> Survey:
    survey = Survey({})
    for message in source.messages(damage):
        name = message.channel.topic
        topic = survey.topics.get(name)
        if topic is None:
            topic = survey.topics[name] = _topic(message.channel, 0)
            survey.start_ns = survey.start_ns or message.log_time_ns
            small = len(message.data) <= _KEPT_BYTES and len(survey.first_calibrations) < _KEPT_CALIBRATIONS
            if topic.kind == "calibration" and small:
                survey.first_calibrations[name] = message
        topic.count = (topic.count or 0) + 1
        survey.start_ns = min(survey.start_ns, message.log_time_ns)
        survey.end_ns = max(survey.end_ns, message.log_time_ns)
        if damage.bytes_read > _SCAN_BYTES and len(survey.of_kind("image")) > 1 < len(survey.first_calibrations):
            survey.whole = False
            break
    return survey


def _topic(channel: Channel, count: int | None) -> Topic:
    kind = kind_of(channel.schema_name)
    return Topic(channel.topic, kind, channel.schema_name, channel.message_encoding, count)


def read_calibration_messages(
    source: Source, survey: Survey, topics: tuple[str, str], decoder: MessageDecoder
) -> tuple[CalibrationMessage, CalibrationMessage]:
    """The first readable calibration of each of the two topics, sent early or late.

    Raises LogError where one of them is never sent.
    """
    wanted = frozenset(topics)
    found: dict[str, CalibrationMessage] = {}
    problems: dict[str, str] = {}

    def take(message: Message) -> None:
        topic = message.channel.topic
        if topic not in found:
            try:
                found[topic] = decoder.calibration(message)
            except UndecodableMessage as error:
                problems[topic] = f" ({error})"

    for topic in wanted & survey.first_calibrations.keys():
        take(survey.first_calibrations[topic])
    if len(found) < len(wanted):
        for message in source.messages(Damage(), wanted):
            take(message)
            if len(found) == len(wanted):
                break
    for topic in topics:
        if topic not in found:
            problem = f"no calibration could be read from topic {topic}{problems.get(topic, '')}"
            raise calibration_error(f"{source.path}: {problem}")
    return found[topics[0]], found[topics[1]]
