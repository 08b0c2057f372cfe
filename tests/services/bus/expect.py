"""The next message of a subscription, for tests."""


def expect(subscription):
    """The next message; fails if none comes within 5 s."""
    message = subscription.wait(5.0)
    assert message is not None
    return message
