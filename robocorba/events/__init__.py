"""The event service: channels, subscriptions, queues, and the federation of channels by gateways.

It imports errors and system. Read first: channel (passes each event on), proxies (one for each client), feed and
gateway (the two ends of a link), federation (the links and interests as one channel knows them). `corba.event_client`
is the client's side."""
