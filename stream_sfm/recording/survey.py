"""What a log holds, found before anything is estimated: topics, counts, duration, first calibrations."""

from dataclasses import dataclass, field

from ..errors import LogError
from ..mcap_file.log_file import Damage, LogFile, LogMessage
from .messages import CalibrationMessage, MessageDecoder, UndecodableMessage, kind_of

# A log without an index is scanned so far at most, once cameras and calibrations have been met.
_SCAN_BYTES = 256 * 2**20
# Of so many calibration topics the first message is kept if it is no larger; others are read when they are needed.
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
    """The topics by name, the span of log times, and the first message of calibration topics met, of a few."""

    topics: dict[str, Topic]
    start_ns: int = 0
    end_ns: int = 0
    whole: bool = True  # false: the scan ended early, counts and span are lower bounds
    first_calibrations: dict[str, LogMessage] = field(default_factory=dict)

    def of_kind(self, *kinds: str) -> dict[str, int | None]:
        """Topic -> count for the topics of these kinds."""
        return {t.name: t.count for t in self.topics.values() if t.kind in kinds}


def survey_log(file: LogFile, damage: Damage) -> Survey:
    """From the index where there is a sound one, else by reading the file in order."""
    index = file.index
    if index is None:
        return _scan(file, damage)
    survey = Survey({}, index.start_ns, index.end_ns)
    for channel in index.channels.values():
        schema = index.schemas.get(channel.schema_id)
        count = index.counts.get(channel.id, 0) if index.counts else None
        known = survey.topics.get(channel.topic)
        if known is None:
            survey.topics[channel.topic] = Topic(
                channel.topic, kind_of(schema), schema.name if schema else "", channel.message_encoding, count
            )
        elif count is not None:
            known.count = (known.count or 0) + count
    return survey


def _scan(file: LogFile, damage: Damage) -> Survey:
    survey = Survey({})
    for message in file.messages(damage):
        name = message.channel.topic
        topic = survey.topics.get(name)
        if topic is None:
            kind = kind_of(message.schema)
            topic = survey.topics[name] = Topic(
                name, kind, message.schema.name if message.schema else "", message.channel.message_encoding, 0
            )
            survey.start_ns = survey.start_ns or message.log_time_ns
            small = len(message.data) <= _KEPT_BYTES and len(survey.first_calibrations) < _KEPT_CALIBRATIONS
            if kind == "calibration" and small:
                survey.first_calibrations[name] = message
        topic.count = (topic.count or 0) + 1
        survey.start_ns = min(survey.start_ns, message.log_time_ns)
        survey.end_ns = max(survey.end_ns, message.log_time_ns)
        if damage.bytes_read > _SCAN_BYTES and len(survey.of_kind("image")) > 1 < len(survey.first_calibrations):
            survey.whole = False
            break
    return survey


def read_calibration_messages(
    file: LogFile, survey: Survey, topics: tuple[str, str], decoder: MessageDecoder
) -> tuple[CalibrationMessage, CalibrationMessage]:
    """The first readable calibration of each of the two topics, sent early or late.

    Raises LogError where one of them is never sent.
    """
    found: dict[str, CalibrationMessage] = {}
    problem = ""

    def take(message: LogMessage) -> None:
        nonlocal problem
        if message.channel.topic not in found:
            try:
                found[message.channel.topic] = decoder.calibration(message)
            except UndecodableMessage as error:
                problem = f" ({error})"

    for topic in topics:
        if topic in survey.first_calibrations:
            take(survey.first_calibrations[topic])
    if any(t not in found for t in topics):
        for message in file.messages(Damage(), frozenset(topics)):
            take(message)
            if all(t in found for t in topics):
                break
    for topic in topics:
        if topic not in found:
            raise LogError(
                f"{file.path}: no calibration could be read from topic {topic}{problem}; "
                "give the calibration of these cameras",
                hint=("calibration",),
            )
    return found[topics[0]], found[topics[1]]
