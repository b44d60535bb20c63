"""Model files spoilt by the thousand: each is read to a sane mechanism or refused by an error of ours."""
