"""The event service: channels, subscriptions, queues, and the federation. Knows no CORBA."""
