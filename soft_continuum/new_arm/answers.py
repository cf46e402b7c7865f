# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Questions about an arm, and their answers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, pi
from typing import TypeAlias

from soft_continuum.nodes.parameter_table import ALL_PARAMETERS
from soft_continuum.parameters.parameter import Parameter, ParameterError, Value

PLANAR, SPATIAL, TENDONS = KINDS = ('planar', 'spatial', 'tendons')
UNITS = {'': 1.0, 'mm': 1e-3, 'g': 1e-3, 'degrees': pi / 180.0, 'GPa': 1e9, 'N': 1.0,
         'N m^2': 1.0}
"""Input units, in SI."""
COUNTS = ('segments', 'tendons')  # integer questions that are not parameters
DIGITS = 4  # of suggestions
PARAMETERS = {p.name: p for p in ALL_PARAMETERS}
Given: TypeAlias = str | tuple[float, ...]
"""A choice, or numbers in the input unit."""


class AnswerError(ParameterError):
    """An answer is invalid; the message says what was given and what is allowed."""

    def __init__(self, name: str, problem: str) -> None:
        """name: of the question."""
        super().__init__(f'{name}: {problem}')
        self.name = name


@dataclass(frozen=True)
class Suggestion:
    """A choice or numbers (in SI) assumed when nothing is known, and their origin."""

    value: str | Sequence[float]
    why: str


@dataclass(frozen=True)
class Answer:
    """An answer, in the input unit; assumed: why it was assumed, empty if it was given."""

    value: Given
    assumed: str = ''


@dataclass(frozen=True)
class Question:
    """
    One question about an arm.

    name: of the answer, and of its option.  text: the question.  suggest: a function of the
    previous answers.  parameter: the parameter that the answer sets, empty if it only serves to
    derive others.  unit: one of UNITS.  per: the items that have a number each, one of PER. low,
    high: in SI, unless the parameter has them.  choices: texts with their meanings. kinds: of arms
    to which it applies.
    """

    name: str
    text: str
    suggest: Callable[['Answers'], Suggestion]
    parameter: str = ''
    unit: str = ''
    per: str = ''
    low: float = -inf
    high: float = inf
    choices: Mapping[str, str] | None = None
    kinds: tuple[str, ...] = KINDS

    @property
    def option(self) -> str:
        """The option of the command line."""
        return f'--{self.name.replace("_", "-")}'

    @property
    def sets(self) -> Parameter | None:
        """The parameter that the answer sets."""
        return PARAMETERS[self.parameter] if self.parameter else None

    @property
    def whole(self) -> bool:
        """Whether the numbers are whole ones."""
        return not self.choices and (
            self.sets.type_name.startswith('integer') if self.sets else self.name in COUNTS)

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest number, in the unit that is typed."""
        low, high = (self.sets.low, self.sets.high) if self.sets else (self.low, self.high)
        return max(low, self.low) / UNITS[self.unit], min(high, self.high) / UNITS[self.unit]

    def count(self, answers: 'Answers') -> int:
        """Return the number of values, unless one applies to all; 0: some segments."""
        return PER[self.per](answers)

    def read(self, text: str) -> Given:
        """Parse the typed text; raises AnswerError with the allowed answers."""
        if self.choices:
            if text not in self.choices:
                raise AnswerError(self.name, f'{text!r} given; allowed: {", ".join(self.choices)}')
            return text
        low, high = self.bounds
        found = []
        for word in text.replace(' ', ',').strip(',').split(','):
            try:
                number = float(word)
            except ValueError:
                number = float('nan')
            if not low <= number <= high or (self.whole and not number.is_integer()):
                raise AnswerError(
                    self.name, f'{word!r} given; allowed: {"whole " if self.whole else ""}numbers '
                    f'from {low:g} to {high:g} {self.unit}'.rstrip() + ', with commas between')
            found.append(number)
        return tuple(found)

    def check(self, value: Given, answers: 'Answers') -> None:
        """Raise AnswerError for numbers that contradict the previous answers."""
        if isinstance(value, str):
            return
        count = self.count(answers)
        if not count and (len(set(value)) < len(value) or max(value) > answers.segments):
            raise AnswerError(
                self.name, f'{", ".join(f"{number:g}" for number in value)} given; allowed: '
                f'numbers from 1 to {answers.segments}, each once')
        if count and len(value) not in {1, count}:
            several = f'1 or {count} numbers' if count > 1 else 'one number'
            raise AnswerError(self.name, f'{len(value)} numbers given; allowed: {several}')

    def suggested(self, answers: 'Answers') -> Answer:
        """Return the value assumed when nothing is known, rounded as it is shown."""
        found = self.suggest(answers)
        if isinstance(found.value, str):
            return Answer(found.value, found.why)
        numbers = [float(f'{number / UNITS[self.unit]:.{DIGITS}g}') for number in found.value]
        same = len(set(numbers)) == 1
        return Answer(tuple(numbers[:1] if same else numbers), found.why)

    def value(self, answer: Answer) -> Value:
        """Return an answer in SI, as the value of its parameter."""
        if isinstance(answer.value, str):
            return answer.value
        numbers = tuple(number * UNITS[self.unit] for number in answer.value)
        if self.sets is not None and not isinstance(self.sets.default, tuple):
            return round(numbers[0]) if self.whole else numbers[0]
        return numbers


class Answers:
    """The answers so far, in SI for estimates."""

    def __init__(self, questions: Sequence[Question], answers: Mapping[str, Answer]) -> None:
        """answers: by the names of questions."""
        self._questions = {question.name: question for question in questions}
        self._answers = answers

    def text(self, name: str) -> str:
        """Return a choice."""
        return str(self._answers[name].value)

    def all(self, name: str, count: int = 0) -> tuple[float, ...]:
        """Return numbers in SI; one is repeated ``count`` times if that is given."""
        found = tuple(number * UNITS[self._questions[name].unit]
                      for number in self._answers[name].value if not isinstance(number, str))
        return found * count if len(found) == 1 and count else found

    def one(self, name: str) -> float:
        """Return a number in SI."""
        return self.all(name)[0]

    @property
    def kind(self) -> str:
        """One of KINDS."""
        return self.text('kind')

    @property
    def segments(self) -> int:
        """Number of segments of the arm."""
        return round(self.one('segments'))

    def each(self, name: str) -> tuple[float, ...]:
        """Return a number in SI for every segment."""
        return self.all(name, self.segments)


PER: Mapping[str, Callable[[Answers], int]] = {
    '': lambda answers: 1, 'segment': lambda answers: answers.segments,
    'disc': lambda answers: answers.segments + 1, 'some segments': lambda answers: 0,
    'end': lambda answers: len(answers.all('tendon_ends'))}
"""How many numbers a question may have; discs: base first, ends: of the tendons."""
